#pragma once

#include <functional>
#include <stop_token>

namespace stipple {

/// How a computation runs: how it is stopped, watched, and on how many threads. Results never
/// depend on it.
struct RunContext {
    std::stop_token stop{};  ///< asks the computation to end with `Cancelled`
    std::function<void(double)>
        progress{};  ///< called with 0..1, never decreasing, on the calling thread only; only by
                     ///< long computations, and not always up to 1
    unsigned threads = 0;  ///< 0: one per hardware thread; at most 1024 are used

    /// Reports `fraction` and throws `Cancelled` when asked to stop. For the calling thread.
    void checkpoint(double fraction) const;

    /// Throws `Cancelled` when asked to stop. For any thread.
    void throw_if_stopped() const;

    /// `threads`, or the number of hardware threads; at least 1.
    unsigned thread_count() const noexcept;

    /// A context whose progress 0..1 appears as `from..to` of this one.
    RunContext part(double from, double to) const;

    /// A context whose progress nobody sees.
    RunContext quietly() const { return {.stop = stop, .progress = {}, .threads = threads}; }
};

}  // namespace stipple
