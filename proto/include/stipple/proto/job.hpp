#pragma once

#include "stipple/codec.hpp"
#include "stipple/lod_pyramid.hpp"
#include "stipple/proto/problem.hpp"
#include "stipple/simplify.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace stipple::proto {

/// How results are encoded.
struct OutputOptions {
    std::vector<CloudFormat> formats;  ///< simplify: one, `ply` by default; pyramid: `drc` and `ply` by default
    DracoEncodeOptions draco;
};

struct SimplifyJob {
    SimplifyOptions options;
    OutputOptions output;
};
struct PyramidJob {
    LodPyramidOptions options;
    OutputOptions output;
};

/// The body of `POST /v1/jobs`. Unknown fields are refused by name. Core's own option structs: one definition of each default.
///
///     {"type": "simplify", "input": "<sha-256>", "method": "hierarchical", "points": 5000 | "ratio": 0.01 |
///      "max_cluster_size": 50 and/or "max_variation": 0.05,
///      "representative": "nearest" | "surface" | "centroid", "seed": 0, "reductions": {"intensity": "mean"},
///      "format": "ply" | "drc", "draco": {"position_bits": 14, "precision": 0.001, "normal_bits": 10, "coding": "auto"}}
///     {"type": "pyramid", "input": "<sha-256>", "levels": [1000, 10000] | "ratio": 4, "base_points": 10000,
///      "representative": …, "reductions": …, "formats": ["drc", "ply"], "draco": {…}}
struct JobRequest {
    std::string input;  ///< id of the cloud: SHA-256 of its bytes, 64 lower-case hexadecimal digits
    std::variant<SimplifyJob, PyramidJob> job;
};

/// `simplify` or `pyramid`.
std::string_view type_name(const JobRequest& request) noexcept;
/// One form for equal requests (defaults written out, keys sorted), so that its hash identifies the work.
std::string to_json(const JobRequest& request);
/// Strict: @throws Error(InvalidArgument) naming the field, its value and what is expected.
JobRequest job_request_from_json(std::string_view json);

/// accepted -> running -> successful | failed | dismissed; accepted -> dismissed. As OGC API - Processes names them.
enum class JobStatus { Accepted, Running, Successful, Failed, Dismissed };
std::string_view to_string(JobStatus status) noexcept;
JobStatus job_status_from_name(std::string_view name);
/// Whether nothing more will happen.
bool is_final(JobStatus status) noexcept;

struct Link {
    std::string rel, href, type;
};

/// The job document (a superset of OGC `statusInfo`).
///
///     {"id", "type", "status", "progress": 0..100, "stage", "message", "created", "started", "finished", "updated",
///      "request": {…}, "levels_ready": 2, "links": [{"rel": "self" | "results" | "events" | "pyramid", "href", "type"}],
///      "problem": {…} when failed}
struct JobDocument {
    std::string id;  ///< 32 lower-case hexadecimal digits, drawn at random
    JobRequest request;
    JobStatus status = JobStatus::Accepted;
    double progress = 0;            ///< 0..100, never decreasing within an attempt
    std::string stage;              ///< queued, decode, clean, simplify, encode, done
    std::string message;            ///< for people
    std::string created, started, finished, updated;  ///< RFC 3339 UTC with milliseconds; empty when not yet
    unsigned levels_ready = 0;      ///< outputs that can be fetched already
    std::vector<Link> links;
    std::optional<Problem> problem;
};
std::string to_json(const JobDocument& document);
JobDocument job_document_from_json(std::string_view json);

/// The document of a cloud: {"id", "format", "bytes", "created", "points"?, "removed"?, "bounds"?, "attributes"?, "links"}. What stands after
/// `created` is known once a job has decoded it.
struct CloudAttribute {
    std::string name;  ///< `normal`, `color` or as in the file
    std::string type;  ///< `float32`, `uint8`, ...
    unsigned components = 1;
};
struct CloudStatistics {
    std::uint64_t points = 0;      ///< in the file
    std::uint64_t non_finite = 0;  ///< removed before any work
    std::uint64_t duplicates = 0;
    Aabb bounds;                   ///< of what is left
    std::vector<CloudAttribute> attributes;
    std::string encoding;               ///< DecodeReport::encoding
    std::vector<std::string> skipped;   ///< DecodeReport::skipped
    std::vector<std::string> comments;  ///< DecodeReport::comments
};
struct CloudDocument {
    std::string id;
    CloudFormat format = CloudFormat::Ply;
    std::uint64_t bytes = 0;
    std::string created;
    std::optional<CloudStatistics> statistics;
    std::vector<Link> links;
};
std::string to_json(const CloudDocument& document);
CloudDocument cloud_document_from_json(std::string_view json);
std::string to_json(const CloudStatistics& statistics);
CloudStatistics cloud_statistics_from_json(std::string_view json);
/// What is told of a cloud that was decoded and cleaned.
CloudStatistics describe(const PointCloud& cleaned, const DecodeReport& report, std::uint64_t non_finite,
                         std::uint64_t duplicates);

/// A page of documents: {"items": […], "next": "<opaque cursor>"?}.
std::string page_json(const std::vector<std::string>& items, const std::optional<std::string>& next);

}  // namespace stipple::proto
