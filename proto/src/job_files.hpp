#pragma once

#include "stipple/proto/job_process.hpp"
#include "stipple/proto/run_job.hpp"

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>

namespace stipple::proto {

/// Writes a file of a job. Under its name it is whole or not there; whoever keeps it makes it
/// durable. @throws Error(TooLarge) above the job's limit for a file, StorageFull, or
/// Error(Internal) where the system refuses it for another reason.
void write_whole_file(const std::filesystem::path& file, std::span<const std::byte> bytes,
                      const JobSpec& spec);

/// A cloud's file in the job's folder: `<stem>.<format>`, whole as above; without a stem its hash.
OutputFile write_output(const std::string& stem, CloudFormat format,
                        std::span<const std::byte> bytes, const JobSpec& spec);

}  // namespace stipple::proto
