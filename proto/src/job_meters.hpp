#pragma once

#include "stipple/proto/run_job.hpp"

#include <array>
#include <chrono>
#include <cstddef>
#include <functional>
#include <optional>

namespace stipple::proto {

/// Of a job, in the order of `kJobStages`.
enum Stage : std::size_t { kDecode, kClean, kSimplify, kUpsample, kAnalyze, kEvaluate, kEncode };

/// Adds the time until its end to `seconds`.
class Stopwatch {
public:
    explicit Stopwatch(double& seconds) : seconds_(seconds) {}
    ~Stopwatch() { seconds_ += std::chrono::duration<double>(Clock::now() - start_).count(); }
    Stopwatch(const Stopwatch&) = delete;
    Stopwatch& operator=(const Stopwatch&) = delete;

private:
    using Clock = std::chrono::steady_clock;

    double& seconds_;
    Clock::time_point start_ = Clock::now();
};

/// How much of the 100 percent each stage has.
using StageShares = std::array<double, kJobStages.size()>;
StageShares stage_shares(const JobRequest& request);

/// One percentage for the whole job, which never decreases.
class ProgressMeter {
public:
    ProgressMeter(const StageShares& shares, const std::function<void(const JobReport&)>& report)
        : shares_(shares), report_(report) {}

    void advance(Stage stage, double fraction);

private:
    static constexpr std::chrono::milliseconds kInterval{50};

    double percent() const;

    const StageShares shares_;
    const std::function<void(const JobReport&)>& report_;
    std::array<double, kJobStages.size()> done_{};
    std::optional<Stage> reported_stage_;
    std::chrono::steady_clock::time_point next_report_;
};

}  // namespace stipple::proto
