#pragma once

#include "stipple/codec.hpp"
#include "stipple/proto/job_request.hpp"
#include "stipple/proto/problem.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stipple::proto {

/// accepted -> running -> successful | failed | dismissed; accepted -> dismissed; running -> accepted, if an attempt
/// ended without a result and the job will be retried: the server was stopped or restarted, its worker was lost, or its
/// process died or found the disk full. The names are those of OGC API - Processes.
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
///      "request": {…}, "input_name": "scan.ply"?, "levels_ready": 2, "links": [{"rel": "self" | "results" | "events" | "pyramid", "href", "type"}],
///      "problem": {…} when failed}
struct JobDocument {
    std::string id;  ///< 32 lower-case hexadecimal digits, drawn at random
    JobRequest request;
    std::optional<std::string> input_name;  ///< of the input cloud, while that exists
    JobStatus status = JobStatus::Accepted;
    double progress = 0;            ///< 0..100, never decreasing within an attempt
    std::string stage;              ///< queued, done, or one of `kJobStages`
    std::string message;            ///< for people
    std::string created, started, finished, updated;  ///< RFC 3339 UTC with milliseconds; empty if not yet known
    unsigned levels_ready = 0;      ///< outputs that can be fetched already
    std::vector<Link> links;
    std::optional<Problem> problem;
};
std::string to_json(const JobDocument& document);
JobDocument job_document_from_json(std::string_view json);

/// The document of a cloud: {"id", "name"?, "format", "bytes", "created", "points"?, "removed"?, "bounds"?,
/// "attributes"?, "links"}. The fields after `created` are known once a job has decoded it.
struct CloudAttribute {
    std::string name;  ///< `normal`, `color` or the name in the file
    std::string type;  ///< `float32`, `uint8`, ...
    unsigned components = 1;
};
struct CloudStatistics {
    std::uint64_t points = 0;      ///< in the file
    std::uint64_t non_finite = 0;  ///< removed before any processing
    std::uint64_t duplicates = 0;
    std::optional<std::uint64_t> outliers{};  ///< of a job that removed them, after the others
    Aabb bounds;                   ///< of the remaining points
    std::optional<Vec3d> middle{};  ///< of most of them (`middle_of_most`)
    std::vector<CloudAttribute> attributes;
    std::string encoding;               ///< DecodeReport::encoding
    std::vector<std::string> skipped;   ///< DecodeReport::skipped
    std::vector<std::string> comments;  ///< DecodeReport::comments

    /// What was removed, of all kinds.
    std::uint64_t removed() const noexcept { return non_finite + duplicates + outliers.value_or(0); }
    std::uint64_t remaining() const noexcept { return points - removed(); }
};
struct CloudDocument {
    std::string id;
    std::optional<std::string> name;  ///< for people: that of the file, if given
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
std::vector<CloudAttribute> attributes_of(const PointCloud& cloud);
/// The statistics of a cloud that was decoded and cleaned.
CloudStatistics describe(const PointCloud& cleaned, const DecodeReport& report, std::uint64_t non_finite,
                         std::uint64_t duplicates);

/// A page of documents: {"items": […], "next": "<opaque cursor>"?}.
std::string page_json(const std::vector<std::string>& items, const std::optional<std::string>& next);

}  // namespace stipple::proto
