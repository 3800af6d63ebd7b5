#include "cli/interrupt.hpp"

#include <unistd.h>
#include <chrono>
#include <csignal>

namespace stipple::cli {
namespace {

/// Those of a terminal that closes, too; not those that this process was started to ignore, as by
/// `nohup`, but for the one that wakes the watcher.
sigset_t watched_signals() {
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGTERM);
    for (const int signal : {SIGINT, SIGHUP}) {
        struct sigaction before {};
        if (::sigaction(signal, nullptr, &before) == 0 && before.sa_handler != SIG_IGN)
            sigaddset(&signals, signal);
    }
    return signals;
}

}  // namespace

void die_of(int signal) {
    std::signal(signal, SIG_DFL);
    sigset_t one;
    sigemptyset(&one);
    sigaddset(&one, signal);
    ::pthread_sigmask(SIG_UNBLOCK, &one, nullptr);
    std::raise(signal);
    ::_exit(128 + signal);  // the first process of a container dies of none
}

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
            die_of(signal);
        }
    }
}

}  // namespace stipple::cli
