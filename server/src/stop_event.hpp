#pragma once

#include "store/posix_file.hpp"

#include <atomic>

namespace stipple::server {

/// An event that stays: once raised, every wait on it returns, also one in `poll`.
class StopEvent {
public:
    StopEvent();
    void raise() noexcept;
    bool raised() const noexcept { return raised_.load(std::memory_order_acquire); }
    int fd() const noexcept { return fd_.get(); }

private:
    FileDescriptor fd_;
    std::atomic<bool> raised_ = false;
};

}  // namespace stipple::server
