#include "stop_event.hpp"

#include <sys/eventfd.h>

namespace stipple::server {

StopEvent::StopEvent() : fd_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (!fd_) throw_errno("cannot make", "an eventfd");
}

void StopEvent::raise() noexcept {
    raised_.store(true, std::memory_order_release);
    ::eventfd_write(fd_.get(), 1);
}

}  // namespace stipple::server
