#pragma once

#include "job_meters.hpp"
#include "stipple/proto/run_job.hpp"

#include <chrono>
#include <cstdint>
#include <functional>

namespace stipple::proto {

/// A job while it runs, whatever it makes: its input, its stages, what it reports and costs.
class JobRun {
public:
    /// `spec` and `report` must outlive it.
    JobRun(const JobSpec& spec, const std::function<void(const JobReport&)>& report,
           const RunContext& context);

    const JobSpec& spec() const noexcept { return spec_; }
    JobCost& cost() noexcept { return cost_; }
    /// How much memory a file may ask for, and what else is told of foreign bytes.
    DecodeLimits limits() const;

    /// A context whose progress is that of a stage.
    RunContext in_stage(Stage stage);
    /// A context whose progress nobody sees.
    RunContext quietly() const { return context_.quietly(); }
    void advance(Stage stage, double fraction) { meter_.advance(stage, fraction); }

    /// The input, cleaned; what it is is reported.
    PointCloud read();
    /// How far a result is from the cloud it was made of.
    ErrorFigures result_error(const PointCloud& cloud, const PointCloud& result,
                              const RunContext& context);

    void report(const JobReport& what) const { report_(what); }
    /// The last report of a success.
    void report_cost();

private:
    using Clock = std::chrono::steady_clock;

    const JobSpec& spec_;
    const std::function<void(const JobReport&)>& report_;
    const Clock::time_point start_ = Clock::now();
    ProgressMeter meter_;
    RunContext context_;
    JobCost cost_;
};

/// The figures of a result's error: without histograms, which only evaluations have.
ErrorFigures figures_of_result(SurfaceError error, const SurfaceErrorOptions& options,
                               std::uint64_t of_cloud, std::uint64_t of_result);

// What takes more than a few lines to make of the input.
void make_pyramid(JobRun& run, PointCloud&& cloud, const PyramidJob& job);
void evaluate(JobRun& run, const PointCloud& reference, const EvaluateJob& job);

}  // namespace stipple::proto
