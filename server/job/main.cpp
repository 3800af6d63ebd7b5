// stipple-job: does one job in a process of its own, so that a hostile or huge cloud ends this
// process and nothing else.
//
// The process holds nothing but memory and a scratch folder of its starter, so SIGKILL, which ends
// it on the spot, even deep inside a decoder, is the quickest and the safest way to stop.

#include "last_words.hpp"
#include "sandbox.hpp"
#include "stipple/heap.hpp"
#include "stipple/proto/run_job.hpp"

#include <unistd.h>
#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>
#include <utility>

namespace {

namespace proto = stipple::proto;
using stipple::Error;
using stipple::ErrorCode;

constexpr const char* kUsage = R"(usage: stipple-job SPEC

Runs the job described by the JSON file SPEC and reports on standard output, one JSON object per line; the last one is
{"cost": ...} or {"problem": ...}, with exit status 0 for both. stippled starts it; by hand, `stipple simplify` is more
convenient.

SPEC: {"request": {...}, "input_file": "...", "output_dir": "...", "limits": {"max_points": N, "max_attributes": N},
       "max_memory_bytes": N, "max_cpu_seconds": N, "max_file_bytes": N, "threads": N}
      (0: no limit, of the last four; one thread per processor)

environment:
  STIPPLE_JOB_PARENT=PID    end when this process, the parent, ends
  STIPPLE_JOB_SANDBOX=off   run even if the kernel has no seccomp: limits only
)";

void report_problem(proto::Problem problem) {
    if (const auto stage = stipple::job::current_stage(); !stage.empty()) problem.stage = stage;
    stipple::job::write_report(problem);
}

proto::JobSpec read_spec(const char* file) {
    std::ifstream in(file, std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    if (!in) throw Error(ErrorCode::Internal, std::string(file) + ": cannot be read");
    return proto::job_spec_from_json(text);
}

void leave_the_world(const proto::JobSpec& spec) {
    if (const char* parent = std::getenv("STIPPLE_JOB_PARENT")) {
        int id = 0;
        std::from_chars(parent, parent + std::strlen(parent), id);
        stipple::job::die_with(id);
    }
    stipple::job::set_limits(spec);
    const char* sandbox = std::getenv("STIPPLE_JOB_SANDBOX");
    if (sandbox != nullptr && std::string_view(sandbox) == "off") return;
    try {
        stipple::job::enter_sandbox();
    } catch (const Error& error) {
        throw Error(ErrorCode::Internal,
                    std::string("refusing to decode outside a sandbox: ") + error.what() +
                        ": allow seccomp here, or set STIPPLE_JOB_SANDBOX=off");
    }
}

void run(const char* spec_file) {
    const proto::JobSpec spec = read_spec(spec_file);
    stipple::job::prepare_last_words(spec);
    leave_the_world(spec);
    try {
        proto::run_job(spec, stipple::job::write_report);
    } catch (const Error&) {
        throw;
    } catch (const std::exception& error) {
        if (!stipple::job::is_out_of_memory(error)) throw;
        throw Error(ErrorCode::TooLarge, proto::memory_limit_message(spec));
    }
}

}  // namespace

int main(int argc, char** argv) {
    const bool asked =
        argc == 2 && (argv[1] == std::string_view("--help") || argv[1] == std::string_view("-h"));
    if (asked || argc != 2 || argv[1][0] == '-') {
        std::fputs(kUsage, asked ? stdout : stderr);
        return asked ? 0 : 2;
    }
    stipple::prefer_huge_heap();
    try {
        run(argv[1]);
    } catch (const Error& error) {
        report_problem(proto::problem_from(error));
    } catch (const std::exception& error) {
        report_problem(proto::problem_from(ErrorCode::Internal, error.what()));
    }
    // Straight out: giving gigabytes back piece by piece would take longer than the exit does.
    ::_exit(0);
}
