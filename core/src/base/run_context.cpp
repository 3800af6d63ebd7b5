#include "stipple/run_context.hpp"

#include "stipple/error.hpp"

#include <algorithm>
#include <thread>

namespace stipple {

void RunContext::checkpoint(double fraction) const {
    throw_if_stopped();
    if (progress) progress(std::clamp(fraction, 0.0, 1.0));
}

void RunContext::throw_if_stopped() const {
    if (stop.stop_requested()) throw Cancelled();
}

unsigned RunContext::thread_count() const noexcept {
    constexpr unsigned kMost = 1024;
    return std::min(kMost,
                    threads != 0 ? threads : std::max(1U, std::thread::hardware_concurrency()));
}

RunContext RunContext::part(double from, double to) const {
    RunContext result{stop, {}, threads};
    if (progress) {
        result.progress = [outer = progress, from, to](double f) { outer(from + (to - from) * f); };
    }
    return result;
}

}  // namespace stipple
