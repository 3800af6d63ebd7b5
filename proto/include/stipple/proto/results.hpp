#pragma once

#include "stipple/error_bounded.hpp"
#include "stipple/lod_tiles.hpp"
#include "stipple/proto/job.hpp"
#include "stipple/proto/problem.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stipple::proto {

/// Upper bounds of the error of a file's contents, in the mean and at the farthest place, in input units.
struct FileError {
    double mean = 0, max = 0;
};

/// One encoded file of a result.
struct OutputFile {
    CloudFormat format = CloudFormat::Ply;
    std::uint64_t bytes = 0;
    std::string sha256;  ///< of the bytes; also the strong ETag
    std::string href;    ///< where it is served: absolute path on the server, relative file name in an exported folder
    std::optional<LodTile> tile{};  ///< for a `glb`: its contents, without the streams
    std::optional<FileError> error{};  ///< for a `drc`, if that of its cloud was measured: including the largest
                                       ///< rounding
};

/// A picture: PNG.
struct PictureFile {
    unsigned width = 0, height = 0;  ///< pixels
    std::uint64_t bytes = 0;
    std::string sha256, href;  ///< as those of an `OutputFile`
};

/// What was measured for a bounded error (`simplify_within_error`), in input units.
struct MeasuredBound {
    double max_error = 0;  ///< the bound
    double forward = 0, backward = 0;  ///< largest distances, from the input's surface and from the result's
    std::uint64_t samples = 0;         ///< on the surface of the input
    ErrorSampling sampling = ErrorSampling::Surface;  ///< of these
    std::uint64_t points_off_surface = 0;  ///< of the input, farther than the bound from its own surface: not counted
    unsigned tries = 0;                ///< number of clouds measured
    bool whole = false;                ///< no smaller cloud was found within the bound: the result is the input itself
    bool ended_early = false;  ///< the search reached its limit of work: fewer points may hold
    std::optional<TooFar> too_far{};      ///< if `whole`: the cloud with the most points among those tried that
                                          ///< exceeded the bound
};
std::string to_json(const MeasuredBound& bound);  ///< `bound` of a result, below

/// Distances in one direction, in input units.
struct CurveDistances {
    double max = 0, mean = 0, rms = 0;
};
/// The error of a cloud of a curve.
struct CurveError {
    CurveDistances forward, backward;  ///< from the input's surface, and from the cloud's
    double diagonal = 0;               ///< of the input's box
};
std::string to_json(const CurveError& error);  ///< `curve` of a result, below

/// One output cloud: the only one of a job, or a level of a pyramid (0 the coarsest). In an evaluation it is a
/// candidate, in the order of the request; `files` are then its map.
struct OutputCloud {
    unsigned level = 0;
    std::uint64_t points = 0;
    double spacing = 0;  ///< mean distance to the nearest other point, input units
    Aabb bounds;
    std::vector<OutputFile> files;  ///< one per format; for `glb` one per tile
    std::optional<ErrorFigures> error{};      ///< as an approximation of the input, if measured
    std::optional<LodFigures> decoded{};      ///< of all its tiles together, as decoded
    std::optional<Vec3d> origin{};  ///< `PointCloud::origin`: positions of its Draco file are relative to it
    std::vector<CloudAttribute> attributes{};  ///< as `CloudStatistics`: the order of generic attributes in the files
    std::optional<MeasuredBound> bound{};      ///< for a job with `max_error`
    std::optional<CurveError> curve{};         ///< for a curve; the cloud then has no files
    std::vector<PictureFile> pictures{};      ///< of all candidates, on the first one
};

/// Time and memory of a job.
struct JobCost {
    double decode_seconds = 0;    ///< including cleaning
    double simplify_seconds = 0;  ///< the computation alone, for every type of job
    double splats_seconds = 0;    ///< measuring the splats of the result
    double error_seconds = 0;     ///< measuring the error of the result
    double encode_seconds = 0;
    double total_seconds = 0;
    std::uint64_t peak_memory_bytes = 0;
    unsigned threads = 0;
};

/// The results of a job. The same struct is `GET /v1/jobs/{id}/results`, and a pyramid's `manifest.json`:
///
///     {"schema": "stipple-results/1" | "stipple-pyramid/1" | "stipple-evaluation/1", "complete": true, "request": {…},
///      "source": {cloud statistics, "sha256"}, "method": "multiphase",
///      "levels": [{"level": 0, "points": 8396, "spacing": 0.5, "bounds": {"min": [x, y, z], "max": […]},
///                  "origin": [x, y, z], "attributes": [{"name", "type", "components"}],
///                  "files": [{"format": "drc", "bytes": 20000, "sha256": "…", "href": "…", "error": {"mean", "max"}},
///                            {"format": "glb", …, "tile": {"parent": 0, "points": 8396, "bits": 9, "step": 0.01,
///                             "offset": [x, y, z], "last": [511, 400, 300], "error": {"mean", "max", "p99", "mean_confidence", "samples"},
///                             "spacing": 0.5, "cover_radius": 0.9}}],
///                  "decoded": {"bits" of its tiles, "error": {as that of a tile}, "spacing", "cover_radius"},
///                  "error": {as in evaluation.hpp},
///                  "bound": {"max_error": 0.1, "forward": 0.08, "backward": 0.09, "samples": 400000, "sampling": "particles",
///                            "tries": 30, "whole": false},
///                            if whole also "too_far": {"points": 900, "place": [x, y, z], "distance": 0.12}
///                  "pictures": [{"width", "height", "bytes", "sha256", "href"}]}],
///      "cost": {"seconds": {"decode", "simplify", "splats", "error", "encode", "total"}, "peak_memory_bytes", "threads"}}
///
/// Tiles are numbered from 0 in listed order, over all levels; `parent` is such a number, absent for the first. A tile's points lie on
/// a grid: offset + step * (0 .. last), relative to the centre of the source's bounds. Its figures, and those of all tiles of a
/// level (`decoded`), are `LodFigures`.
/// The levels of a curve have no files, but "curve": {"forward": {"max", "mean", "rms"}, "backward": {…}, "diagonal"}.
/// `bound` is present only with `max_error`. `method` is absent if there is none (analyze). `complete` is false while levels are still to
/// come; `cost` is present only if `complete`.
struct Results {
    JobRequest request;
    std::optional<CloudStatistics> source;  ///< absent until decoded
    std::vector<OutputCloud> levels;        ///< coarsest first
    bool complete = false;
    std::optional<JobCost> cost;
    std::optional<Problem> problem{};  ///< for a job that ended without success: why no more will come
};
/// The method by which a job produces points; absent if it produces none.
std::optional<Method> method_of(const JobRequest& request) noexcept;
/// Raises the mean, the maximum and the 99th percentile of each tile's error to those of the tiles below it. Each tile
/// is measured at its own places, and with few of them a finer tile's error can be larger by chance; the published
/// error never increases from a tile to those below it, along any path.
void raise_tile_errors(Results& pyramid);
/// Whoever reads a pyramid relies on a tile's parent being listed before it.
/// @throws Error(MalformedInput) naming the tile that has another.
void require_parents_first(std::span<const OutputCloud> levels);
std::string to_json(const Results& results);
/// The result of an evaluation: the reply to `POST /v1/evaluations` and the figures of `stipple evaluate`. For one
/// candidate: its error with `candidate` {id, points} and `files`; for several: {"candidates": [the same for each]}. In
/// addition `reference` {id, points} and `pictures`.
std::string evaluation_json(const Results& results);
Results results_from_json(std::string_view json);

}  // namespace stipple::proto
