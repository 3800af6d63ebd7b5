#pragma once

#include "stipple/proto/job_process.hpp"
#include "stipple/run_context.hpp"

#include <array>
#include <functional>
#include <string_view>

namespace stipple::proto {

/// The stages of a job in their order. A job has one of `simplify`, `upsample`, `analyze` and
/// `evaluate`. A pyramid alternates between its last two; the percentage never decreases.
inline constexpr std::array<std::string_view, 7> kJobStages = {
    "decode", "clean", "simplify", "upsample", "analyze", "evaluate", "encode"};

/// Runs a job: decode, clean, compute, encode level by level into `spec.output_dir`. stipple-job
/// and the command line share this code path. A level is reported once its files are complete,
/// coarsest first (the feature lines of an analysis are its level 1; a curve's, finest first); then
/// the cost. Progress is reported when a stage begins, and otherwise at most 20 times per second.
/// The time of `decode` includes the cleaning; that of `simplify` is the computation alone, on the
/// cloud in memory; those of `splats` and `error` are separate.
///
/// The caller sets the limits of the process (memory, processor time). `context.progress` is not
/// called: progress goes to `report`.
/// @throws Error, CandidateError, Cancelled; Error(MalformedInput) if no points are left after
/// cleaning; bad_alloc becomes Error(TooLarge) naming `spec.max_memory_bytes`.
void run_job(const JobSpec& spec, const std::function<void(const JobReport&)>& report, const RunContext& context = {});

/// The message if `spec.max_memory_bytes` were not enough.
std::string memory_limit_message(const JobSpec& spec);

}  // namespace stipple::proto
