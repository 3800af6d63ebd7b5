#include "cli/interrupt.hpp"

#include <unistd.h>
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
    for (int signal = 0; ::sigwait(&signals, &signal) == 0;) {
        if (ending_) return;
        if (signal_.exchange(signal) != 0) ::_exit(128 + signal);
        source_.request_stop();
    }
}

}  // namespace stipple::cli
