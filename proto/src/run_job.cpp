#include "stipple/proto/run_job.hpp"

#include "draco_rounding.hpp"
#include "evaluation_notes.hpp"
#include "job_cloud.hpp"
#include "job_files.hpp"
#include "job_meters.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/copc.hpp"
#include "stipple/error_bounded.hpp"
#include "stipple/globe.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/picture/visual_error.hpp"
#include "stipple/progressive_cloud.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/tiles.hpp"
#include "stipple/surface_attributes.hpp"

#include <sys/resource.h>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <new>
#include <numeric>
#include <utility>

namespace stipple::proto {

namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Report = std::function<void(const JobReport&)>;

double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

MeasuredBound measured(const ErrorBoundedCloud& found) {
    return {.max_error = found.bound,
            .forward = found.error.forward.max,
            .backward = found.error.backward.max,
            .samples = found.error.forward.samples,
            .sampling = found.sampling,
            .points_off_surface = found.points_off_surface,
            .tries = found.tries,
            .whole = found.whole,
            .ended_early = found.ended_early,
            .too_far = found.too_far};
}

// Of a pyramid's stage `encode`.
constexpr double kTiler = 0.15;    // to measure the cloud for its tiles
constexpr double kMeasured = 0.3;  // of a level's part, to measure its error

/// Runs one job: a member function for each stage.
class JobRun {
public:
    JobRun(const JobSpec& spec, const Report& report, const RunContext& context)
        : spec_(spec),
          report_(report),
          meter_(stage_shares(spec.request), report),
          context_(context) {
        if (spec.threads != 0) context_.threads = spec.threads;
    }

    void run() {
        const auto start = Clock::now();
        PointCloud cloud = read();
        std::visit([&](const auto& job) { make(std::move(cloud), job); }, spec_.request.job);
        cost_.total_seconds = seconds_since(start);
        report_cost();
    }

private:
    /// A context whose progress is that of a stage.
    RunContext in_stage(Stage stage) {
        meter_.advance(stage, 0);
        return {context_.stop, [this, stage](double f) { meter_.advance(stage, f); },
                context_.threads};
    }

    PointCloud read() {
        const Stopwatch watch(cost_.decode_seconds);
        DecodeReport decoded;
        PointCloud cloud = read_cloud(spec_.input_file, limits(), in_stage(kDecode), &decoded);
        meter_.advance(kDecode, 1);
        const std::vector<CloudAttribute> attributes = attributes_of(cloud);
        if (wants_source_index(spec_.request)) add_source_index(cloud);
        const std::optional<OutlierOptions> outliers = outliers_of(spec_.request);
        const double cleaned = outliers ? 0.3 : 1;  // of the stage
        const RunContext context = in_stage(kClean);
        const CleaningReport removed = clean(cloud, context.part(0, cleaned));

        CloudStatistics source = describe(cloud, decoded, removed.non_finite, removed.duplicates);
        source.attributes = attributes;  // those of the file, without what was added
        try {
            require_usable(cloud, decoded.points, removed, source.bounds);
        } catch (const Error&) {
            report_(source);
            throw;
        }
        if (outliers) {
            source.outliers = remove_outliers(cloud, *outliers, context.part(cleaned, 1));
            source.bounds = bounds(cloud);
        }
        meter_.advance(kClean, 1);
        report_(source);
        return cloud;
    }

    DecodeLimits limits() const {
        DecodeLimits limits = spec_.limits;
        limits.max_memory_bytes = spec_.max_memory_bytes;
        return limits;
    }

    /// A context whose progress nobody sees.
    RunContext quietly() const { return {context_.stop, {}, context_.threads}; }

    void make(PointCloud&& cloud, const SimplifyJob& job) {
        SimplifyOptions options = job.options;
        to_frame_of(cloud, options.particles);
        make_points(kSimplify, cloud, job, [&](const RunContext& context) {
            if (!options.max_error && !options.max_error_rel)
                return simplify(cloud, options, context);
            ErrorBoundedCloud found = simplify_within_error(cloud, options, context);
            bound_ = measured(found);
            if (!found.whole) {
                bound_error_ =
                    without_histograms(std::move(found.error), {.sampling = found.sampling},
                                       cloud.size(), found.cloud.size());
            }
            return std::move(found.cloud);
        });
    }

    void make(PointCloud&& cloud, const UpsampleJob& job) {
        UpsampleOptions options = job.options;
        to_frame_of(cloud, options.particles);
        make_points(kUpsample, cloud, job,
                    [&](const RunContext& context) { return upsample(cloud, options, context); });
    }

    /// How far a result is from the cloud it was made of.
    ErrorFigures result_error(const PointCloud& cloud, const PointCloud& result,
                              const RunContext& context) {
        const Stopwatch watch(cost_.error_seconds);
        SurfaceError error;
        if (result.positions == cloud.positions) {
            error.diagonal = bounds(cloud).diagonal();  // nothing was changed
        } else {
            error = estimate_error(cloud, result, context);
        }
        return without_histograms(std::move(error), quick_options(cloud.size(), result.size()),
                                  cloud.size(), result.size());
    }

    static ErrorFigures without_histograms(SurfaceError error, const SurfaceErrorOptions& options,
                                           std::uint64_t of_cloud, std::uint64_t of_result) {
        error.forward.histogram.clear();
        error.backward.histogram.clear();
        return error_figures(error, options, of_cloud, of_result);
    }

    template <typename Job, typename Compute>
    void make_points(Stage stage, const PointCloud& cloud, const Job& job, Compute&& compute) {
        constexpr double kComputed = 0.7, kSplats = 0.8;  // of the stage; the error is the rest
        const RunContext context = in_stage(stage);
        PointCloud result;
        {
            const Stopwatch watch(cost_.simplify_seconds);
            result = compute(context.part(0, kComputed));
        }
        {
            const Stopwatch watch(cost_.splats_seconds);
            add_splats(result, job.added.splats, context.part(kComputed, kSplats));
        }
        std::optional<ErrorFigures> error;
        if (job.error) {
            error = bound_error_ ? std::move(bound_error_)
                                 : result_error(cloud, result, context.part(kSplats, 1));
        }
        meter_.advance(stage, 1);
        points_to_encode_ = result.size();
        encode(level(0, std::move(result)), job.output, error);
    }

    void make(PointCloud&& cloud, const AnalyzeJob& job) {
        SurfaceAttributeOptions options = job.options;
        if (options.viewpoint) *options.viewpoint -= cloud.origin;
        PointCloud lines;
        {
            const Stopwatch watch(cost_.simplify_seconds);
            lines = add_surface_attributes(cloud, options, in_stage(kAnalyze));
        }
        meter_.advance(kAnalyze, 1);
        points_to_encode_ = cloud.size() + lines.size();
        // Points stay in the order of the file, and those of a line one after the other.
        OutputOptions output = job.output;
        if (output.draco.coding == DracoCoding::Auto) output.draco.coding = DracoCoding::Sequential;
        encode(level(0, std::move(cloud)), output);
        if (!lines.empty()) encode(level(1, std::move(lines)), output);
    }

    /// Figures alone, in the order in which they come, the finest first; numbered from the
    /// coarsest.
    void make(PointCloud&& cloud, const CurveJob& job) {
        ErrorCurveOptions options = job.options;
        to_frame_of(cloud, options.simplification.particles);
        auto number = static_cast<unsigned>(curve_counts(cloud.size(), options).size());
        const auto distances = [](const DirectedError& error) {
            return CurveDistances{error.max, error.mean, error.rms};
        };
        const Stopwatch watch(cost_.simplify_seconds);
        error_curve(
            cloud, options,
            [&](const CurvePoint& point) {
                report_(OutputCloud{
                    .level = --number,
                    .points = point.points,
                    .spacing = 0,
                    .bounds = bounds(cloud),
                    .files = {},
                    .curve = CurveError{distances(point.error.forward),
                                        distances(point.error.backward), point.error.diagonal}});
            },
            {}, in_stage(kSimplify));
        meter_.advance(kSimplify, 1);
        meter_.advance(kEncode, 1);
    }

    LodLevel level(unsigned number, PointCloud&& cloud) const {
        const double spacing = mean_spacing(cloud.positions, quietly());
        return {number, std::move(cloud), spacing};
    }

    void make(PointCloud&& cloud, const PyramidJob& job) {
        const Aabb box = bounds(cloud);
        if (job.epsg) globe_frame(*job.epsg, 0.5 * (box.min + box.max));  // refuses others' places
        const std::vector<std::uint64_t> sizes = lod_sizes(cloud.size(), job.options);
        points_to_encode_ = std::accumulate(sizes.begin(), sizes.end(), std::uint64_t{0});
        finest_points_ = sizes.back();

        const double encoded_before = cost_.encode_seconds;
        const auto start = Clock::now();
        if (std::ranges::find(job.output.formats, CloudFormat::Glb) != job.output.formats.end()) {
            const Stopwatch watch(cost_.encode_seconds);
            LodTileOptions tiles = job.tiles;
            tiles.additive = job.options.nested;
            tiles.finest_points = finest_points_;
            tiles.level_errors = job.error;
            if (!job.error && tiles.errors == LodErrors::Sure) tiles.errors = LodErrors::Rough;
            tiler_ = std::make_unique<LodTiler>(cloud, tiles, in_stage(kEncode).part(0, kTiler));
            points_of_source_ = cloud.size();
            encode_begin_ = kTiler;
        }
        LodPyramidOptions levels = job.options;
        to_frame_of(cloud, levels.simplification.particles);
        levels.spacing = tiler_ == nullptr;  // else the tiles say it
        if (tiler_ != nullptr) levels.order = tiler_->order();
        if (job.base_bytes) fit_base(levels, *job.base_bytes);
        build_lod_pyramid(
            std::move(cloud), levels,
            [&](LodLevel&& made) {
                std::optional<ErrorFigures> error;
                if (job.error && tiler_ == nullptr) {
                    // The level of all points is the source itself.
                    const PointCloud& source = cloud.empty() ? made.cloud : cloud;
                    const double to = std::lerp(encoded(), encoded(made.cloud.size()), kMeasured);
                    error = result_error(source, made.cloud, in_stage(kEncode).part(encoded(), to));
                }
                encode(std::move(made), job.output, error);
            },
            in_stage(kSimplify));
        meter_.advance(kSimplify, 1);
        // Levels are measured and encoded as they come: that is not the computation's.
        cost_.simplify_seconds =
            seconds_since(start) - cost_.error_seconds - (cost_.encode_seconds - encoded_before);
        meter_.advance(kEncode, 1);
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
            const Stopwatch watch(cost_.encode_seconds);
            const bool whole = level.size() == points_of_source_;
            std::uint64_t bytes = 0;
            for (const LodTile& tile : tiler_->add_level(level, whole, quietly()))
                bytes += encode_glb(tile).size();
            tiler_->restart();
            if (level.size() == 1 && bytes > most_bytes) {
                throw Error(ErrorCode::InvalidArgument, "base_bytes " + std::to_string(most_bytes) +
                                                            ": one point takes " +
                                                            std::to_string(bytes));
            }
            return bytes <= most_bytes;
        };
    }

    // Evaluation.

    /// A candidate, counted from 0.
    /// @throws CandidateError.
    PointCloud read_candidate(std::size_t number) {
        const Stopwatch watch(cost_.decode_seconds);
        try {
            DecodeReport decoded;
            meter_.advance(kDecode, 1);  // once more: a failure tells its stage
            PointCloud cloud =
                read_cloud(spec_.candidate_files.at(number), limits(), quietly(), &decoded);
            meter_.advance(kClean, 1);
            const CleaningReport removed = clean(cloud, quietly());
            require_usable(cloud, decoded.points, removed, bounds(cloud));
            return cloud;
        } catch (const Error& error) {
            throw CandidateError(static_cast<unsigned>(number + 1), error);
        }
    }

    struct Candidate {
        OutputCloud level;
        DirectedError samples;  ///< kept for its map
    };

    void make(PointCloud&& reference, const EvaluateJob& job) {
        const bool shown = job.options.pictures || !job.output.formats.empty();
        SurfaceErrorOptions options = job.options.measure;
        options.keep_samples = shown;
        SurfaceErrorMeter meter = [&] {
            const Stopwatch watch(cost_.error_seconds);
            return SurfaceErrorMeter(reference, options, quietly());
        }();
        std::vector<Candidate> candidates;
        for (std::size_t i = 0; i < spec_.candidate_files.size(); ++i)
            candidates.push_back(evaluate(meter, i, reference.size(), options));
        meter_.advance(kEvaluate, 1);
        if (shown) show(candidates, reference.origin, job);
        for (const Candidate& candidate : candidates) report_(candidate.level);
    }

    Candidate evaluate(SurfaceErrorMeter& meter, std::size_t number, std::uint64_t reference_points,
                       const SurfaceErrorOptions& options) {
        const double all = static_cast<double>(spec_.candidate_files.size());
        const double before = static_cast<double>(number);
        const PointCloud cloud = read_candidate(number);
        SurfaceError error;
        {
            const Stopwatch watch(cost_.error_seconds);
            error =
                meter.measure(cloud, in_stage(kEvaluate).part(before / all, (before + 1) / all));
        }
        Candidate candidate;
        candidate.level = {.level = static_cast<unsigned>(number),
                           .points = cloud.size(),
                           .spacing = mean_spacing(cloud.positions, quietly()),
                           .bounds = bounds(cloud),
                           .files = {},
                           .attributes = attributes_of(cloud)};
        candidate.samples.p99 = error.forward.p99;
        candidate.samples.positions = std::move(error.forward.positions);
        candidate.samples.distances = std::move(error.forward.distances);
        candidate.level.error = error_figures(error, options, reference_points, cloud.size());
        return candidate;
    }

    /// Maps and pictures of all candidates, in the same colours.
    void show(std::vector<Candidate>& candidates, const Vec3d& origin, const EvaluateJob& job) {
        const Stopwatch watch(cost_.encode_seconds);
        double p99 = 0;
        for (const Candidate& candidate : candidates) p99 = std::max(p99, candidate.samples.p99);
        const double range = job.options.range.value_or(round_up(p99));
        std::vector<PointCloud> maps;
        for (Candidate& candidate : candidates) {
            candidate.level.error->range = range;
            maps.push_back(colored_by_distance(candidate.samples, origin, range));
            candidate.level.attributes = attributes_of(maps.back());
            candidate.level.origin = maps.back().origin;
            candidate.samples = {};
            for (const CloudFormat format : job.output.formats) {
                LodLevel map{candidate.level.level, maps.back(), 0};
                candidate.level.files.push_back(
                    write(map, format, job.output.draco, in_stage(kEncode)));
            }
        }
        if (job.options.pictures) candidates.front().level.pictures = {draw(candidates, maps, job)};
        meter_.advance(kEncode, 1);
    }

    PictureFile draw(const std::vector<Candidate>& candidates, const std::vector<PointCloud>& maps,
                     const EvaluateJob& job) {
        const SurfaceError& first = candidates.front().level.error->error;
        const double range = *candidates.front().level.error->range;
        VisualErrorOptions options{.range = range,
                                   .legend = distance_legend(range, first),
                                   .views = job.options.views,
                                   .up = job.options.up};
        std::vector<VisualError> shown;
        for (std::size_t i = 0; i < maps.size(); ++i) {
            const OutputCloud& level = candidates[i].level;
            const std::string label = job.options.labels.empty()
                                          ? "candidate " + std::to_string(i + 1)
                                          : job.options.labels[i];
            shown.push_back({label, error_notes(level.points, level.error->error), &maps[i]});
        }
        const Picture picture = draw_visual_error(shown, options, in_stage(kEncode));
        const std::string name = "picture.png";
        write_whole_file(fs::path(spec_.output_dir) / name, picture.png, spec_);
        return {picture.width, picture.height, picture.png.size(), sha256_hex(picture.png), name};
    }

    /// Spends the level: Draco, which takes most memory, comes last and takes it over.
    void encode(LodLevel&& made, const OutputOptions& options,
                const std::optional<ErrorFigures>& error = {}) {
        const Stopwatch watch(cost_.encode_seconds);
        const std::size_t points = made.cloud.size();
        const double to = encoded(points);
        double from = error ? std::lerp(encoded(), to, kMeasured) : encoded();
        const double share = (to - from) / static_cast<double>(options.formats.size());

        OutputCloud level = {.level = made.level,
                             .points = points,
                             .spacing = made.spacing,
                             .bounds = bounds(made.cloud),
                             .files = {},
                             .error = error,
                             .origin = made.cloud.origin,
                             .attributes = attributes_of(made.cloud),
                             .bound = bound_};
        std::vector<std::vector<OutputFile>> files(options.formats.size());
        const auto encode_as = [&](std::size_t i) {
            const CloudFormat format = options.formats[i];
            const RunContext context = in_stage(kEncode).part(from, from + share);
            from += share;
            if (format == CloudFormat::Glb) {
                write_tiles(made, context, files[i]);
                if (const std::optional<SurfaceError>& of_level = tiler_->level_error())
                    level.error =
                        without_histograms(*of_level, quick_options(points_of_source_, points),
                                           points_of_source_, points);
                level.decoded = tiler_->figures();
                level.spacing = tiler_->level_spacing();
                if (points == points_of_source_) tiler_.reset();  // no level comes after
            } else if (format == CloudFormat::Progressive || format == CloudFormat::Copc) {
                if (points == finest_points_) files[i] = {write_finest(made, format, context)};
            } else {
                files[i] = {write(made, format, options.draco, context)};
                if (const auto& of_level = level.error; format == CloudFormat::Draco && of_level)
                    files[i].front().error = draco_error(of_level->error, options.draco, level);
            }
        };
        for (const bool draco : {false, true})
            for (std::size_t i = 0; i < files.size(); ++i)
                if ((options.formats[i] == CloudFormat::Draco) == draco) encode_as(i);
        for (std::vector<OutputFile>& some : files)
            std::ranges::move(some, std::back_inserter(level.files));
        points_encoded_ += points;
        meter_.advance(kEncode, encoded());
        report_(std::move(level));
    }

    /// That of a level, with what its Draco file rounds; nothing where steps would be longer than
    /// its spacing: the file then has shorter ones, or exact floats.
    static std::optional<FileError> draco_error(const SurfaceError& error,
                                                const DracoEncodeOptions& draco,
                                                const OutputCloud& level) {
        const double step = longest_step(draco, (level.bounds.max - level.bounds.min).maxCoeff());
        if (step > level.spacing) return std::nullopt;
        const FileError added = error_of_step(step);
        return FileError{error.mean() + added.mean, error.max() + added.max};
    }

    /// How much of `encode` is done once `more` points are.
    double encoded(std::uint64_t more = 0) const {
        return std::lerp(
            encode_begin_, 1.0,
            static_cast<double>(points_encoded_ + more) / static_cast<double>(points_to_encode_));
    }

    /// Spends the level where it is written as Draco.
    OutputFile write(LodLevel& made, CloudFormat format, const DracoEncodeOptions& draco,
                     const RunContext& context) {
        const std::vector<std::byte> bytes =
            format == CloudFormat::Draco ? encode_draco(std::move(made.cloud), draco, context)
                                         : encode_ply(made.cloud, {}, context);
        return write_output("level-" + std::to_string(made.level), format, bytes, spec_);
    }

    /// A file for each tile, named by its hash: so the tileset names it, wherever it is served.
    void write_tiles(const LodLevel& made, const RunContext& context,
                     std::vector<OutputFile>& files) {
        const bool whole = made.cloud.size() == points_of_source_;
        for (LodTile& tile :
             tiler_->add_level(made.cloud, whole, context.part(0, 0.9), made.order)) {
            const std::vector<std::byte> bytes = encode_glb(tile);
            tile.streams.clear();
            files.push_back(write_output("", CloudFormat::Glb, bytes, spec_));
            files.back().tile = std::move(tile);
        }
    }

    /// The finest level as one file that viewers read a part of: a stream or an octree.
    OutputFile write_finest(const LodLevel& finest, CloudFormat format, const RunContext& context) {
        const auto& job = std::get<PyramidJob>(spec_.request.job);
        const LodTileOptions& tiles = job.tiles;
        const std::vector<std::byte> bytes =
            format == CloudFormat::Copc
                ? encode_copc(finest.cloud, {.precision = tiles.precision, .epsg = job.epsg},
                              context)
                : encode_progressive(
                      finest.cloud,
                      {.position_bits = tiles.position_bits, .precision = tiles.precision},
                      context);
        return write_output("cloud", format, bytes, spec_);
    }

    void report_cost() {
        rusage usage{};
        ::getrusage(RUSAGE_SELF, &usage);
        cost_.peak_memory_bytes = static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
        cost_.threads = context_.thread_count();
        report_(cost_);
    }

    const JobSpec& spec_;
    const Report& report_;
    ProgressMeter meter_;
    RunContext context_;
    JobCost cost_;
    std::unique_ptr<LodTiler> tiler_;  ///< of a pyramid, when it is to have tiles
    std::uint64_t points_of_source_ = 0;
    std::uint64_t finest_points_ = 0;          ///< of a pyramid
    std::optional<MeasuredBound> bound_;       ///< of the result, where there was one to keep
    std::optional<ErrorFigures> bound_error_;  ///< by which it was found to be kept
    std::uint64_t points_to_encode_ = 0;
    std::uint64_t points_encoded_ = 0;
    double encode_begin_ = 0;  ///< of `encode`, after what is done once
};

}  // namespace

void run_job(const JobSpec& spec, const Report& report, const RunContext& context) {
    try {
        JobRun(spec, report, context).run();
    } catch (const std::bad_alloc&) {
        throw Error(ErrorCode::TooLarge, memory_limit_message(spec));
    } catch (const std::length_error&) {
        // A container asked for more than any memory holds, as a hostile count makes it do.
        throw Error(ErrorCode::TooLarge, memory_limit_message(spec));
    }
}

std::string memory_limit_message(const JobSpec& spec) {
    if (spec.max_memory_bytes == 0) return "the memory of this machine is too small for the cloud";
    return "the job needs more than its memory limit of " + std::to_string(spec.max_memory_bytes) +
           " bytes: upload a smaller cloud, or raise the limit";
}

}  // namespace stipple::proto
