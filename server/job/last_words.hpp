#pragma once

#include "stipple/proto/job_process.hpp"

#include <exception>
#include <string_view>

namespace stipple::job {

/// The reports on standard output, one line each, and the problem that is written when the process
/// can do nothing else any more: out of processor time in a signal handler, out of memory where
/// nobody catches. Those lines are prepared while all is well, so that writing one takes neither
/// memory nor locks that might be held.

/// Prepares the last words for a job of these limits and installs what says them.
void prepare_last_words(const proto::JobSpec& spec);

/// Whether an exception means that memory was not to be had, be it for the stack of a thread.
bool is_out_of_memory(const std::exception& error) noexcept;

/// Writes one report whole: never interleaved with last words.
void write_report(const proto::JobReport& report);

/// The stage that the last progress report named; empty before the first.
std::string_view current_stage() noexcept;

}  // namespace stipple::job
