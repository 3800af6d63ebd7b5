#include "job_meters.hpp"

#include <algorithm>
#include <cmath>
#include <string>

namespace stipple::proto {

StageShares stage_shares(const JobRequest& request) {
    // As the time goes for millions of points.
    StageShares shares{};
    shares[kDecode] = 8;
    shares[kClean] = 4;
    Stage computed = kSimplify;
    shares[kEncode] = 4;
    if (const auto* const pyramid = std::get_if<PyramidJob>(&request.job)) {
        shares[kDecode] = 3;
        shares[kClean] = 2;
        const Method method = pyramid->options.simplification.method;
        shares[kEncode] = method == Method::Hierarchical ? 65
                          : method == Method::Multiphase ? 30
                                                         : 10;
    } else if (std::holds_alternative<UpsampleJob>(request.job)) {
        computed = kUpsample;
    } else if (std::holds_alternative<AnalyzeJob>(request.job)) {
        computed = kAnalyze;
    } else if (const auto* const evaluation = std::get_if<EvaluateJob>(&request.job)) {
        computed = kEvaluate;
        if (evaluation->options.pictures) shares[kEncode] = 70;
    }
    shares[computed] = 100 - shares[kDecode] - shares[kClean] - shares[kEncode];
    return shares;
}

void ProgressMeter::advance(Stage stage, double fraction) {
    done_[stage] = std::max(done_[stage], std::clamp(fraction, 0.0, 1.0));
    const auto now = std::chrono::steady_clock::now();
    if (stage == reported_stage_ && now < next_report_ && fraction < 1) return;
    reported_stage_ = stage;
    next_report_ = now + kInterval;
    report_(JobProgress{std::string(kJobStages[stage]), percent()});
}

double ProgressMeter::percent() const {
    double sum = 0;
    for (std::size_t i = 0; i < done_.size(); ++i) sum += shares_[i] * done_[i];
    return std::round(sum * 10) / 10;
}

}  // namespace stipple::proto
