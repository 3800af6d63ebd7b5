#include "job_cloud.hpp"
#include "job_files.hpp"
#include "job_run.hpp"
#include "level_encoder.hpp"
#include "stipple/copc.hpp"
#include "stipple/globe.hpp"
#include "stipple/lod_error_meter.hpp"
#include "stipple/lod_pyramid.hpp"
#include "stipple/lod_tiles.hpp"
#include "stipple/progressive_cloud.hpp"
#include "stipple/proto/tiles.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace stipple::proto {

namespace {

using Clock = std::chrono::steady_clock;

constexpr double kTiler = 0.15;  // of the stage `encode`: to measure the cloud for its tiles

/// Builds a pyramid: levels that are measured and encoded as they come.
class PyramidRun {
public:
    PyramidRun(JobRun& run, const PyramidJob& job, const PointCloud& cloud)
        : run_(run),
          job_(job),
          points_of_source_(cloud.size()),
          sizes_(lod_sizes(cloud.size(), job.options)) {
        if (job.epsg) globe_frame(*job.epsg, middle_of_most(cloud));  // refuses others' places
    }

    void build(PointCloud&& cloud) {
        const double encoded_before = run_.cost().encode_seconds;
        const auto start = Clock::now();
        if (std::ranges::find(job_.output.formats, CloudFormat::Glb) != job_.output.formats.end())
            begin_tiles(cloud);
        else if (job_.error && sizes_.front() < points_of_source_)
            begin_errors(cloud);
        LodPyramidOptions levels = job_.options;
        to_frame_of(cloud, levels.simplification.particles);
        levels.spacing = tiler_ == nullptr;  // else the tiles say it
        if (tiler_ != nullptr) levels.order = tiler_->order();
        if (job_.base_bytes) fit_base(levels, *job_.base_bytes);

        LevelEncoder encoder(
            run_, job_.output, std::accumulate(sizes_.begin(), sizes_.end(), std::uint64_t{0}),
            tiler_ == nullptr ? 0 : kTiler,
            [this](const LodLevel& made, CloudFormat format, const RunContext& context,
                   OutputCloud& level) { return write(made, format, context, level); });
        build_lod_pyramid(
            std::move(cloud), levels,
            [&](LodLevel&& made) {
                std::optional<ErrorFigures> error;
                if (job_.error && tiler_ == nullptr)
                    error = error_of(made.cloud, encoder.measuring(made.cloud.size()));
                encoder.encode(std::move(made), error);
            },
            run_.in_stage(kSimplify));
        run_.advance(kSimplify, 1);
        // Levels are measured and encoded as they come: that is not the computation's.
        JobCost& cost = run_.cost();
        cost.simplify_seconds = std::chrono::duration<double>(Clock::now() - start).count() -
                                cost.error_seconds - (cost.encode_seconds - encoded_before);
        run_.advance(kEncode, 1);
    }

private:
    void begin_tiles(const PointCloud& cloud) {
        const Stopwatch watch(run_.cost().encode_seconds);
        LodTileOptions tiles = job_.tiles;
        tiles.additive = job_.options.nested;
        tiles.finest_points = sizes_.back();
        tiles.level_errors = job_.error;
        if (!job_.error && tiles.errors == LodErrors::Sure) tiles.errors = LodErrors::Rough;
        tiler_ = std::make_unique<LodTiler>(cloud, tiles, run_.in_stage(kEncode).part(0, kTiler));
    }

    void begin_errors(const PointCloud& cloud) {
        const Stopwatch watch(run_.cost().error_seconds);
        meter_ = std::make_unique<LodErrorMeter>(cloud, run_.quietly());
    }

    /// Of a level without tiles.
    ErrorFigures error_of(const PointCloud& level, const RunContext& context) {
        const Stopwatch watch(run_.cost().error_seconds);
        SurfaceError error;
        if (level.size() == points_of_source_) {  // the source itself
            error.diagonal = bounds(level).diagonal();
            meter_.reset();  // no level comes after
        } else {
            error = meter_->measure(level, context);
        }
        return figures_of(std::move(error), level.size());
    }

    /// @param points  of the level.
    ErrorFigures figures_of(SurfaceError error, std::uint64_t points) const {
        return figures_of_result(std::move(error), quick_options(points_of_source_, points),
                                 points_of_source_, points);
    }

    /// Has the coarsest level chosen by what its tiles take.
    void fit_base(LodPyramidOptions& levels, std::uint64_t most_bytes) {
        constexpr std::uint64_t kMostPoints = 65'536;
        if (tiler_ == nullptr) {
            throw Error(ErrorCode::InvalidArgument,
                        "base_bytes is the size of a glb: expected glb among the formats");
        }
        levels.base_points = std::clamp<std::uint64_t>(most_bytes, 1, kMostPoints);
        levels.base_fits = [this, most_bytes](const PointCloud& level) {
            const Stopwatch watch(run_.cost().encode_seconds);
            const bool whole = level.size() == points_of_source_;
            std::uint64_t bytes = 0;
            for (const LodTile& tile : tiler_->add_level(level, whole, run_.quietly()))
                bytes += encode_glb(tile).size();
            tiler_->restart();
            if (level.size() == 1 && bytes > most_bytes) {
                throw Error(ErrorCode::InvalidArgument,
                            "a coarsest level of " + std::to_string(most_bytes) +
                                " bytes: expected at least the " + std::to_string(bytes) +
                                " that one point takes");
            }
            return bytes <= most_bytes;
        };
    }

    /// Tiles of every level, and the finest level as a file of its own.
    std::vector<OutputFile> write(const LodLevel& made, CloudFormat format,
                                  const RunContext& context, OutputCloud& level) {
        if (format != CloudFormat::Glb) {
            if (level.points != sizes_.back()) return {};
            return {write_finest(made, format, context)};
        }
        std::vector<OutputFile> files = write_tiles(made, context);
        if (const std::optional<SurfaceError>& error = tiler_->level_error())
            level.error = figures_of(*error, level.points);
        level.decoded = tiler_->figures();
        level.spacing = tiler_->level_spacing();
        if (level.points == points_of_source_) tiler_.reset();  // no level comes after
        return files;
    }

    /// A file for each tile, named by its hash: so the tileset names it, wherever it is served.
    std::vector<OutputFile> write_tiles(const LodLevel& made, const RunContext& context) {
        std::vector<OutputFile> files;
        const bool whole = made.cloud.size() == points_of_source_;
        for (LodTile& tile :
             tiler_->add_level(made.cloud, whole, context.part(0, 0.9), made.order)) {
            const std::vector<std::byte> bytes = encode_glb(tile);
            tile.streams.clear();
            files.push_back(write_output("", CloudFormat::Glb, bytes, run_.spec()));
            files.back().tile = std::move(tile);
        }
        return files;
    }

    /// The finest level as one file that viewers read a part of: a stream or an octree.
    OutputFile write_finest(const LodLevel& finest, CloudFormat format,
                            const RunContext& context) const {
        const LodTileOptions& tiles = job_.tiles;
        const std::vector<std::byte> bytes =
            format == CloudFormat::Copc
                ? encode_copc(finest.cloud, {.precision = tiles.precision, .epsg = job_.epsg},
                              context)
                : encode_progressive(
                      finest.cloud,
                      {.position_bits = tiles.position_bits, .precision = tiles.precision},
                      context);
        return write_output("cloud", format, bytes, run_.spec());
    }

    JobRun& run_;
    const PyramidJob& job_;
    const std::uint64_t points_of_source_;
    const std::vector<std::uint64_t> sizes_;  ///< of the levels, the finest last
    std::unique_ptr<LodTiler> tiler_;         ///< if it is to have tiles, until all are made
    std::unique_ptr<LodErrorMeter> meter_;    ///< if it has none, and is to be measured
};

}  // namespace

void make_pyramid(JobRun& run, PointCloud&& cloud, const PyramidJob& job) {
    PyramidRun(run, job, cloud).build(std::move(cloud));
}

}  // namespace stipple::proto
