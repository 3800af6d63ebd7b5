#include "stipple/proto/run_job.hpp"

#include "job_cloud.hpp"
#include "job_run.hpp"
#include "level_encoder.hpp"
#include "rounding_error.hpp"
#include "stipple/error.hpp"
#include "stipple/error_bounded.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/proto/results.hpp"
#include "stipple/surface_attributes.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <new>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <utility>
#include <variant>

namespace stipple::proto {

namespace {

/// By how much an output moves points within a bound of a box, at most, in input units.
double rounding_of(const OutputOptions& output, const Aabb& box, double bound) {
    if (std::ranges::find(output.formats, CloudFormat::Draco) == output.formats.end()) return 0;
    const DracoEncodeOptions& draco = output.draco;
    if (draco.precision) return error_of_step(2 * *draco.precision).max;
    if (draco.position_bits == 0) return 0;
    const double side = (box.max - box.min).maxCoeff() + 2 * bound;
    return error_of_step(side / (std::exp2(draco.position_bits) - 1)).max;
}

/// What is left of a bound for the cloud where what is written keeps it, too.
/// @throws Error(InvalidArgument) where that is nothing.
double bound_without(double rounding, double bound) {
    if (rounding < bound) return bound - rounding;
    std::ostringstream text;
    text << "max_error " << bound << ": expected more than " << rounding
         << ", by which a Draco file rounds positions here; more position_bits or a smaller "
            "precision round less, and PLY not at all";
    throw Error(ErrorCode::InvalidArgument, text.str());
}

/// @param rounding  of what is written, which counts.
MeasuredBound measured(const ErrorBoundedCloud& found, double rounding) {
    std::optional<TooFar> too_far = found.too_far;
    if (too_far) too_far->distance += rounding;
    return {.max_error = found.bound + rounding,
            .forward = found.error.forward.max + rounding,
            .backward = found.error.backward.max + rounding,
            .samples = found.error.forward.samples,
            .sampling = found.sampling,
            .points_off_surface = found.points_off_surface,
            .tries = found.tries,
            .whole = found.whole,
            .ended_early = found.ended_early,
            .too_far = too_far};
}

LodLevel level(const JobRun& run, unsigned number, PointCloud&& cloud) {
    const double spacing = mean_spacing(cloud.positions, run.quietly());
    return {number, std::move(cloud), spacing};
}

/// What is computed of a cloud, and its error where that is known already.
struct Computed {
    PointCloud cloud;
    std::optional<MeasuredBound> bound{};  ///< if there was one to keep
    std::optional<ErrorFigures> error{};   ///< by which it was found to be kept
};

/// Computes a result of one level, adds its splats, measures its error and writes it.
template <typename Job, typename Compute>
void make_points(JobRun& run, Stage stage, const PointCloud& cloud, const Job& job,
                 Compute&& compute) {
    constexpr double kComputed = 0.7, kSplats = 0.8;  // of the stage; the error is the rest
    const RunContext context = run.in_stage(stage);
    Computed result;
    {
        const Stopwatch watch(run.cost().simplify_seconds);
        result = compute(context.part(0, kComputed));
    }
    {
        const Stopwatch watch(run.cost().splats_seconds);
        add_splats(result.cloud, job.added.splats, context.part(kComputed, kSplats));
    }
    if (!job.error) {
        result.error.reset();
    } else if (!result.error) {
        result.error = run.result_error(cloud, result.cloud, context.part(kSplats, 1));
    }
    run.advance(stage, 1);
    LevelEncoder encoder(run, job.output, result.cloud.size());
    encoder.encode(level(run, 0, std::move(result.cloud)), result.error, result.bound);
}

void make(JobRun& run, PointCloud&& cloud, const SimplifyJob& job) {
    SimplifyOptions options = job.options;
    to_frame_of(cloud, options.particles);
    make_points(run, kSimplify, cloud, job, [&](const RunContext& context) -> Computed {
        if (!options.max_error && !options.max_error_rel)
            return {simplify(cloud, options, context)};
        const Aabb box = bounds(cloud);
        const double bound =
            options.max_error ? *options.max_error : *options.max_error_rel * box.diagonal();
        const double rounding = rounding_of(job.output, box, bound);
        if (rounding > 0) {
            options.max_error = bound_without(rounding, bound);
            options.max_error_rel.reset();
        }
        ErrorBoundedCloud found = simplify_within_error(cloud, options, context);
        Computed result;
        result.bound = measured(found, rounding);
        if (!found.whole) {
            result.error = figures_of_result(std::move(found.error), {.sampling = found.sampling},
                                             cloud.size(), found.cloud.size());
        }
        result.cloud = std::move(found.cloud);
        return result;
    });
}

void make(JobRun& run, PointCloud&& cloud, const UpsampleJob& job) {
    UpsampleOptions options = job.options;
    to_frame_of(cloud, options.particles);
    make_points(run, kUpsample, cloud, job, [&](const RunContext& context) -> Computed {
        return {upsample(cloud, options, context)};
    });
}

void make(JobRun& run, PointCloud&& cloud, const AnalyzeJob& job) {
    SurfaceAttributeOptions options = job.options;
    if (options.viewpoint) *options.viewpoint -= cloud.origin;
    PointCloud lines;
    {
        const Stopwatch watch(run.cost().simplify_seconds);
        lines = add_surface_attributes(cloud, options, run.in_stage(kAnalyze));
    }
    run.advance(kAnalyze, 1);
    // Points stay in the order of the file, and those of a line one after the other.
    OutputOptions output = job.output;
    if (output.draco.coding == DracoCoding::Auto) output.draco.coding = DracoCoding::Sequential;
    LevelEncoder encoder(run, output, cloud.size() + lines.size());
    encoder.encode(level(run, 0, std::move(cloud)));
    if (!lines.empty()) encoder.encode(level(run, 1, std::move(lines)));
}

/// Figures alone, in the order in which they come, the finest first; numbered from the coarsest.
void make(JobRun& run, PointCloud&& cloud, const CurveJob& job) {
    ErrorCurveOptions options = job.options;
    to_frame_of(cloud, options.simplification.particles);
    auto number = static_cast<unsigned>(curve_counts(cloud.size(), options).size());
    const auto distances = [](const DirectedError& error) {
        return CurveDistances{error.max, error.mean, error.rms};
    };
    const Stopwatch watch(run.cost().simplify_seconds);
    error_curve(
        cloud, options,
        [&](const CurvePoint& point) {
            run.report(OutputCloud{
                .level = --number,
                .points = point.points,
                .spacing = 0,
                .bounds = bounds(cloud),
                .files = {},
                .curve = CurveError{distances(point.error.forward), distances(point.error.backward),
                                    point.error.diagonal}});
        },
        {}, run.in_stage(kSimplify));
    run.advance(kSimplify, 1);
    run.advance(kEncode, 1);
}

void make(JobRun& run, PointCloud&& cloud, const PyramidJob& job) {
    make_pyramid(run, std::move(cloud), job);
}

void make(JobRun& run, PointCloud&& cloud, const EvaluateJob& job) {
    evaluate(run, cloud, job);
}

/// Another method that needs less memory, in words.
std::string frugal_method(const JobRequest& request) {
    const std::optional<Method> method = method_of(request);
    const bool has_choice = !std::holds_alternative<UpsampleJob>(request.job);
    if (!has_choice || !method || *method == Method::Voxel || *method == Method::Random) return "";
    const bool needs_most = *method == Method::Iterative || *method == Method::Particles;
    return std::string(", use another method than ") + std::string(to_string(*method)) + " (" +
           (needs_most ? "multiphase" : "voxel") + " needs less)";
}

}  // namespace

void run_job(const JobSpec& spec, const std::function<void(const JobReport&)>& report,
             const RunContext& context) {
    try {
        JobRun run(spec, report, context);
        PointCloud cloud = run.read();
        std::visit([&](const auto& job) { make(run, std::move(cloud), job); }, spec.request.job);
        run.report_cost();
    } catch (const std::bad_alloc&) {
        throw Error(ErrorCode::TooLarge, memory_limit_message(spec));
    } catch (const std::length_error&) {
        // A container asked for more than any memory holds, as a hostile count makes it do.
        throw Error(ErrorCode::TooLarge, memory_limit_message(spec));
    }
}

std::string memory_limit_message(const JobSpec& spec) {
    if (spec.max_memory_bytes == 0) return "the memory of this machine is too small for the cloud";
    const auto* const evaluation = std::get_if<EvaluateJob>(&spec.request.job);
    const std::string remedy = std::holds_alternative<UpsampleJob>(spec.request.job)
                                   ? "ask for fewer points"
                               : evaluation != nullptr && evaluation->options.measure.samples > 0
                                   ? "ask for fewer samples"
                                   : "upload a smaller cloud";
    return "the job needs more than the " + std::to_string(spec.max_memory_bytes) +
           " bytes of memory that it may have, by the size of its input and the limits: " + remedy +
           frugal_method(spec.request) + ", or have the server's --max-memory raised";
}

}  // namespace stipple::proto
