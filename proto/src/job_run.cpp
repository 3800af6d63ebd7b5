#include "job_run.hpp"

#include "job_cloud.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/codec.hpp"
#include "stipple/proto/evaluation.hpp"
#include "stipple/surface_error.hpp"

#include <sys/resource.h>
#include <optional>
#include <utility>
#include <vector>

namespace stipple::proto {

JobRun::JobRun(const JobSpec& spec, const std::function<void(const JobReport&)>& report,
               const RunContext& context)
    : spec_(spec), report_(report), meter_(stage_shares(spec.request), report), context_(context) {
    if (spec.threads != 0) context_.threads = spec.threads;
}

DecodeLimits JobRun::limits() const {
    DecodeLimits limits = spec_.limits;
    limits.max_memory_bytes = spec_.max_memory_bytes;
    return limits;
}

RunContext JobRun::in_stage(Stage stage) {
    advance(stage, 0);
    return {context_.stop, [this, stage](double f) { advance(stage, f); }, context_.threads};
}

PointCloud JobRun::read() {
    const Stopwatch watch(cost_.decode_seconds);
    DecodeReport decoded;
    PointCloud cloud = read_cloud(spec_.input_file, limits(), in_stage(kDecode), &decoded);
    advance(kDecode, 1);
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
        report(source);
        throw;
    }
    if (outliers) {
        source.outliers = remove_outliers(cloud, *outliers, context.part(cleaned, 1));
        source.bounds = bounds(cloud);
        source.middle = middle_of_most(cloud);
    }
    advance(kClean, 1);
    report(source);
    return cloud;
}

ErrorFigures JobRun::result_error(const PointCloud& cloud, const PointCloud& result,
                                  const RunContext& context) {
    const Stopwatch watch(cost_.error_seconds);
    SurfaceError error;
    if (result.positions == cloud.positions) {
        error.diagonal = bounds(cloud).diagonal();  // nothing was changed
    } else {
        error = estimate_error(cloud, result, context);
    }
    return figures_of_result(std::move(error), quick_options(cloud.size(), result.size()),
                             cloud.size(), result.size());
}

void JobRun::report_cost() {
    rusage usage{};
    ::getrusage(RUSAGE_SELF, &usage);
    cost_.total_seconds = std::chrono::duration<double>(Clock::now() - start_).count();
    cost_.peak_memory_bytes = static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
    cost_.threads = context_.thread_count();
    report(cost_);
}

ErrorFigures figures_of_result(SurfaceError error, const SurfaceErrorOptions& options,
                               std::uint64_t of_cloud, std::uint64_t of_result) {
    error.forward.histogram.clear();
    error.backward.histogram.clear();
    return error_figures(error, options, of_cloud, of_result);
}

}  // namespace stipple::proto
