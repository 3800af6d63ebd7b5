#include "cli/interrupt.hpp"

#include <unistd.h>
#include <chrono>
#include <csignal>

namespace stipple::cli {
namespace {

sigset_t watched_signals() {
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    return signals;
}

}  // namespace

InterruptWatch::InterruptWatch() {
    const sigset_t signals = watched_signals();
    ::pthread_sigmask(SIG_BLOCK, &signals, nullptr);
    watcher_ = std::thread([this] { watch(); });
}

InterruptWatch::~InterruptWatch() {
    ending_ = true;
    ::pthread_kill(watcher_.native_handle(),
                   SIGTERM);  // wakes the watcher, which alone waits for it
    watcher_.join();
}

void InterruptWatch::watch() {
    const sigset_t signals = watched_signals();
    // Wrappers send the same signal twice, to the process and to its group: that is one wish, and
    // only one that comes later means that the first was not obeyed soon enough.
    constexpr std::chrono::seconds kSameWish{1};
    std::chrono::steady_clock::time_point first;
    for (int signal = 0; ::sigwait(&signals, &signal) == 0;) {
        if (ending_) return;
        const auto now = std::chrono::steady_clock::now();
        if (signal_.exchange(signal) == 0) {
            first = now;
            source_.request_stop();
        } else if (now - first > kSameWish) {
            ::_exit(128 + signal);
        }
    }
}

}  // namespace stipple::cli
