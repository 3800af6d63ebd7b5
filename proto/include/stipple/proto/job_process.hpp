#pragma once

#include "stipple/proto/results.hpp"

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

// What the server and the process of a job tell each other.

namespace stipple::proto {

/// The specification for stipple-job, in a file named on its command line.
struct JobSpec {
    JobRequest request;
    std::string input_file;  ///< the cloud's bytes
    std::vector<std::string> candidate_files{};  ///< for an evaluation, in the order of the request
    std::string output_dir;  ///< must exist and be empty
    DecodeLimits limits;
    std::uint64_t max_memory_bytes = 0;  ///< RLIMIT_AS; 0: none
    std::uint64_t max_cpu_seconds = 0;   ///< RLIMIT_CPU
    std::uint64_t max_file_bytes = 0;    ///< RLIMIT_FSIZE
    unsigned threads = 0;
};
std::string to_json(const JobSpec& spec);
JobSpec job_spec_from_json(std::string_view json);

/// How far a job is.
struct JobProgress {
    std::string stage;   ///< one of `kJobStages`
    double percent = 0;  ///< of the whole job
};

/// What stipple-job reports on its standard output, one JSON object a line.
///
///     {"progress": {"stage": "decode", "percent": 12.5}}
///     {"source": {cloud statistics}}
///     {"level": {OutputCloud with file names as href, hashes filled}}
///     {"cost": {…}}       the last line of a success
///     {"problem": {…}}    the last line of a failure
using JobReport = std::variant<JobProgress, CloudStatistics, OutputCloud, JobCost, Problem>;
std::string to_json(const JobReport& report);  ///< one line, without line break
/// Of a line: a level of as many tiles as a pyramid may have fits.
inline constexpr std::size_t kMaxReportBytes = 16 << 20;
JobReport job_report_from_json(std::string_view json);

}  // namespace stipple::proto
