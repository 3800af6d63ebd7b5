#pragma once

#include "stipple/codec.hpp"
#include "stipple/error_bounded.hpp"
#include "stipple/lod_pyramid.hpp"
#include "stipple/lod_tiles.hpp"
#include "stipple/outliers.hpp"
#include "stipple/proto/evaluation.hpp"
#include "stipple/simplify.hpp"
#include "stipple/surface_attributes.hpp"

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace stipple::proto {

/// How results are encoded.
struct OutputOptions {
    std::vector<CloudFormat>
        formats;  ///< pyramid: any, by default those that every level has; otherwise `ply` or
                  ///< `drc`, `ply` by default
    DracoEncodeOptions draco;
};

/// Attributes that a job adds to each point. They replace attributes of the input with the same
/// name.
struct AddedAttributes {
    SplatAttributes splats = SplatAttributes::Radius;
    bool source_index = false;  ///< uint32 `source_index`: the number of the point in the file that
                                ///< it was or is nearest to, counted from 0 before cleaning
};

struct SimplifyJob {
    SimplifyOptions options;
    OutputOptions output;
    AddedAttributes added{};
    bool error = true;  ///< whether to measure the error of the result
    std::optional<OutlierOptions> outliers{};  ///< removed first, if present
};
struct UpsampleJob {
    UpsampleOptions options;
    OutputOptions output;
    AddedAttributes added{};
    bool error = true;
    std::optional<OutlierOptions> outliers{};
};
struct AnalyzeJob {
    SurfaceAttributeOptions options;
    OutputOptions output;
    std::optional<OutlierOptions> outliers{};
};
/// What a pyramid can have, in the order in which its files are listed.
inline constexpr std::array kPyramidFormats = {CloudFormat::Draco, CloudFormat::Ply, CloudFormat::Glb,
                                               CloudFormat::Progressive, CloudFormat::Copc};

struct PyramidJob {
    LodPyramidOptions options;  ///< nested levels have additive tiles (`refine`)
    OutputOptions output;
    LodTileOptions tiles{};  ///< for `glb`; bits and precision also for `stpc`, precision for
                             ///< `copc.laz`
    std::optional<std::array<double, 16>>
        transform{};    ///< of the tileset, column-major: from the coordinates of the file to those
                        ///< of the scene, such as the globe (ECEF)
    std::optional<unsigned>
        epsg{};         ///< instead of a transform: the coordinate system of the file, which places
                        ///< it on the globe (`globe_frame`)
    bool error = true;  ///< of every level
    std::optional<std::uint64_t>
        base_bytes{};  ///< instead of `base_points`: size limit of the coarsest level's glb, which
                       ///< has at most 65,536 points and one per byte
    std::optional<OutlierOptions> outliers{};
};
/// Compares clouds with the input, which is the reference.
struct EvaluateJob {
    std::vector<std::string> candidates{};  ///< ids, 1..16
    EvaluationOptions options;
    OutputOptions output;  ///< for the maps: the samples of the reference, coloured by distance;
                           ///< without formats there are no maps
};
inline constexpr std::size_t kMostCandidates = 16;

/// The count-error curve of a method: figures, no clouds.
struct CurveJob {
    ErrorCurveOptions options;
    std::optional<OutlierOptions> outliers{};
};

/// The body of `POST /v1/jobs`: core's own option structs, one definition of each default. Unknown
/// fields are refused by name, and so are fields of another method (`method_fields`).
/// Coordinates (regions, a viewpoint) are those of the file: `run_job` subtracts the origin.
///
///     {"type": "simplify", "input": "<sha-256>", "method": "multiphase",
///      "points": 5000 | "ratio": 0.01 | "max_error": 0.05 | "max_error": "0.1%", "seed": 0, "reductions": {"intensity": "mean"},
///      "splats": "radius" | "none" | "normal" | "ellipse", "source_index": false,
///      "error": true, "format": "ply" | "drc",
///      "draco": {"position_bits": 14, "precision": 0.001, "normal_bits": 10, "coding": "auto"}}
///
/// with the fields of its method:
///
///     multiphase    "oversampling": 3, and those of iterative
///     iterative     "k": 6, "placement": "optimal" | "end-point", "max_displacement": 0.1,
///                   "color_weight": 0, "attribute_weights": {"intensity": 0.1}
///     hierarchical  "representative": "nearest" | "surface" | "centroid"; instead of a target
///                   "max_cluster_size": 50 and/or "max_variation": 0.05
///     incremental   the same; "max_variation" also beside a target
///     particles     "adaptivity": 0, "max_grading": 4, "max_iterations": 40, "tolerance": 0.01,
///                   "regions": [{"sphere": {"center": [0, 0, 0], "radius": 1} |
///                                "box": {"min": [0, 0, 0], "max": [1, 1, 1]} |
///                                "attribute": {"name": "intensity", "low": 0, "high": 1},
///                                "density": 4, "transition": 0.5}]
///     voxel         "representative"; instead of a target "voxel_size": 0.1
///
///     {"type": "upsample", "input": …, "points": 1000000 | "ratio": 4, "seed": 0, "reductions": …,
///      the fields of particles, "splats": …, "source_index": …, "format": …, "draco": …}
///     {"type": "analyze", "input": …, "k": 0, "orient": "mst" | "viewpoint" | "none",
///      "viewpoint": [0, 0, 10], "format": …, "draco": …,
///      "feature_lines": {"variation": 0.03, "high": 0.7, "low": 0.4, "min_links": 4}}
///
///     {"type": "curve", "input": …, "method": …, "points": [1000, 10000] | "count": 24, "seed": 0,
///      the fields of the method}
///
/// Feature lines are extracted if the field is present, and are a second output cloud if there are any.
///
///     {"type": "pyramid", "input": …, "levels": [1000, 10000] | "ratio": 4, "base_points": 10000 |
///      "base_bytes": 15000 (glb), "refine": "replace" | "add" (iterative alone, its default),
///      "method": …, the fields of the method, "reductions": …, "error": true,
///      "formats": ["drc", "ply", "glb"], "draco": …,
///      "tiles": {"position_bits": 14, "precision": 0.001, "max_points": 65536,
///                "attributes": false, "exact_errors": false,
///                "transform": [16 numbers] | "epsg": 32633} (glb)}
///     {"type": "evaluate", "reference": …, "candidates": […] | "candidate": …, "samples": 0,
///      "sampling": "points" | "surface" | "particles", "basis": "linear" | "quadratic" |
///      "samples", "k": 20, "seed": 0, "attributes": false, "map": ["ply", "drc"], "draco": …,
///      "range": 0.5, "pictures": false, "views": ["front", "right", "back", "left"], "up": "y",
///      "labels": ["A"]}
///
/// Every type but evaluate has "remove_outliers": 2.5, in standard deviations; if absent, none are
/// removed.
/// Instead of the id of a cloud, the hash of a PLY or Draco file of a result may be given.
struct JobRequest {
    std::string input;  ///< id of the cloud (of the reference): SHA-256 of its bytes, 64 lower-case
                        ///< hexadecimal digits
    std::variant<SimplifyJob, PyramidJob, UpsampleJob, AnalyzeJob, CurveJob, EvaluateJob> job;
};
/// All ids in a request, the input first.
std::vector<std::string> inputs_of(const JobRequest& request);
/// The field that holds the i-th of them: `input`, `reference`, `candidates[0]`.
std::string input_field(const JobRequest& request, std::size_t i);
/// Whether the job has files of a format: those it names, or drc, ply and glb if it names none.
bool makes(const PyramidJob& job, CloudFormat format);
/// The requirement that `PyramidJob::transform` violates; empty if it is valid.
std::string_view transform_expected(const std::array<double, 16>& transform) noexcept;

/// The names of the types, in the order of the variant.
inline constexpr std::array<std::string_view, 6> kJobTypes = {"simplify", "pyramid", "upsample",
                                                              "analyze", "curve", "evaluate"};
/// The same as errors list them.
inline constexpr const char* kAnyJobType = "simplify, pyramid, upsample, analyze, curve or evaluate";
std::string_view type_name(const JobRequest& request) noexcept;
/// The same text for equal requests (defaults filled in, keys sorted), so that its hash identifies
/// the work.
std::string to_json(const JobRequest& request);
/// Of the text of a request; and of its lists, and of what it says of attributes by name.
inline constexpr std::size_t kMaxRequestBytes = 64 << 10, kMaxRequestItems = 256;

/// Strict: @throws Error(InvalidArgument) naming the field, its value and what is expected.
JobRequest job_request_from_json(std::string_view json);
/// One that was accepted before, as it is told of: fields of a later version are left out.
/// @throws Error(Internal) for one that no version that is known wrote.
JobRequest stored_request_from_json(std::string_view json);
/// As `job_request_from_json`, for `POST /v1/evaluations`, where the type may be omitted.
JobRequest evaluation_from_json(std::string_view json);
/// As `job_request_from_json` for an object as `draco` is in requests.
DracoEncodeOptions draco_options_from_json(std::string_view json);

/// `0.1%` as a fraction of the diagonal: 0.001.
/// @throws Error(InvalidArgument) for other text.
double part_of_diagonal(std::string_view text);
/// The text for a fraction, which reads back as the same number.
std::string percent_text(double part);

/// A field of a simplify request that only some methods have.
struct MethodField {
    std::string_view name;
    std::vector<Method> methods;
    bool has(Method method) const noexcept;
};
std::span<const MethodField> method_fields();
/// `max_variation belongs to hierarchical and incremental, not to voxel`, without the name.
std::string misplaced(const MethodField& field, Method method);

}  // namespace stipple::proto
