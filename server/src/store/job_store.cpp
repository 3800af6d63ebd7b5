#include "store/job_store.hpp"

#include "stipple/error.hpp"

namespace stipple::server {

void check_queued(std::uint64_t waiting, const QueueLimits& limits) {
    if (waiting < limits.max_queued) return;
    throw Error(ErrorCode::QueueFull,
                std::to_string(waiting) + (waiting == 1 ? " job is" : " jobs are") +
                    " waiting already: the limit is " + std::to_string(limits.max_queued) +
                    "; try again when some have run");
}

}  // namespace stipple::server
