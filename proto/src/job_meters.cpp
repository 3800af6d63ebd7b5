#include "job_meters.hpp"

#include <algorithm>
#include <cmath>
#include <string>

namespace stipple::proto {

void ProgressMeter::advance(Stage stage, double fraction) {
    done_[stage] = std::max(done_[stage], std::clamp(fraction, 0.0, 1.0));
    const auto now = std::chrono::steady_clock::now();
    if (stage == reported_stage_ && now < next_report_ && fraction < 1) return;
    reported_stage_ = stage;
    next_report_ = now + kInterval;
    JobReport line;
    line.progress = {std::string(kJobStages[stage].name), percent()};
    report_(line);
}

double ProgressMeter::percent() const {
    double sum = 0;
    for (std::size_t i = 0; i < done_.size(); ++i) sum += kJobStages[i].share * done_[i];
    return std::round(sum * 10) / 10;
}

}  // namespace stipple::proto
