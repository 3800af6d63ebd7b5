#pragma once

#include <atomic>
#include <stop_token>
#include <thread>

namespace stipple::cli {

/// Ends this process as the signal does by default: a shell whose command died of Ctrl-C stops its
/// script, but goes on after one that ended with a status, whatever it is.
[[noreturn]] void die_of(int signal);

/// Turns Ctrl-C (and SIGTERM) into a request to stop, so that everything is left tidy. A second one
/// ends the program at once. Make it before any other thread: they inherit that these signals are
/// blocked.
class InterruptWatch {
public:
    InterruptWatch();
    ~InterruptWatch();
    InterruptWatch(const InterruptWatch&) = delete;
    InterruptWatch& operator=(const InterruptWatch&) = delete;

    std::stop_token token() const noexcept { return source_.get_token(); }
    /// The signal that came, or 0.
    int signal() const noexcept { return signal_; }

private:
    void watch();

    std::stop_source source_;
    std::atomic<int> signal_{0};
    std::atomic<bool> ending_{false};
    std::thread watcher_;
};

}  // namespace stipple::cli
