#pragma once

#include "stipple/proto/results.hpp"
#include "stipple/run_context.hpp"

#include <functional>

namespace stipple::proto {

/// Does what a job says: decode, clean, simplify, encode level by level into `spec.output_dir`. The one code path of
/// stipple-job and of the command line. A level is reported once its files are whole, coarsest first; then the cost.
///
/// Limits of the process (memory, processor time) are the caller's to set. `context.progress` is not called: progress goes to `report`.
/// @throws Error, Cancelled; bad_alloc becomes Error(TooLarge) naming `spec.max_memory_bytes`.
void run_job(const JobSpec& spec, const std::function<void(const JobReport&)>& report, const RunContext& context = {});

}  // namespace stipple::proto
