#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <stop_token>

namespace stipple::server {

/// Tells waiting threads that something was written.
class ChangeSignal {
public:
    std::uint64_t version() const noexcept { return version_.load(std::memory_order_acquire); }

    void bump() {
        {
            const std::lock_guard lock(mutex_);
            version_.fetch_add(1, std::memory_order_acq_rel);
        }
        changed_.notify_all();
    }

    /// Returns when the version is no longer `seen`, at `deadline`, or when asked to stop.
    void wait(std::uint64_t seen, std::chrono::steady_clock::time_point deadline,
              std::stop_token stop) const {
        std::unique_lock lock(mutex_);
        changed_.wait_until(lock, stop, deadline, [&] { return version() != seen; });
    }

private:
    std::atomic<std::uint64_t> version_ = 0;
    mutable std::mutex
        mutex_;  ///< a bump between a waiter's look at the version and its sleep is seen
    mutable std::condition_variable_any changed_;
};

}  // namespace stipple::server
