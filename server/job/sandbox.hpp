#pragma once

#include "stipple/proto/job_process.hpp"

namespace stipple::job {

/// Memory, processor time, size of files, open files, no core dump; the first to be ended where the
/// machine runs out of memory. @throws Error(Internal) naming the limit.
void set_limits(const proto::JobSpec& spec);

/// Dies with the process that started it. `parent` is its id as it said: when it has gone already,
/// this one ends at once.
void die_with(int parent);

/// Gives up for good what a job has no use for: new privileges, programs, processes, sockets, other
/// processes. From then on the kernel answers every call that is not on the list of `sandbox.cpp`
/// with ENOSYS, as if it did not exist.
/// @throws Error(Internal) when the kernel refuses.
void enter_sandbox();

}  // namespace stipple::job
