// One process per job: spawned with nothing but its specification, its output and the log; watched
// until its last word; always reaped. What it says is believed no further than the grammar of
// reports.

#include "stop_event.hpp"
#include "store/posix_file.hpp"
#include "worker/worker_pool.hpp"

#include "stipple/error.hpp"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>
#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace stipple::server {

namespace {

using Clock = std::chrono::steady_clock;
using Outcome = JobRunner::Outcome;

constexpr std::size_t kMaxOutputBytes = 64 << 20;
constexpr int kSpecDescriptor = 3;
constexpr const char* kSpecPath = "/proc/self/fd/3";

std::system_error system_error(const std::string& what, int code = errno) {
    return {code, std::generic_category(), what};
}

/// The specification as a file that only the child can name and that is gone with it.
FileDescriptor spec_file(const proto::JobSpec& spec) {
    const std::string text = to_json(spec);
    FileDescriptor file(::memfd_create("stipple-job-spec", MFD_CLOEXEC));
    if (!file) throw system_error("memfd_create");
    write_all(file, std::as_bytes(std::span(text)), "the specification of a job");
    return file;
}

/// Nothing of the server's environment but what a job may need: no key and no address leaks into
/// it.
std::vector<std::string> environment() {
    std::vector<std::string> result = {"LC_ALL=C",
                                       "STIPPLE_JOB_PARENT=" + std::to_string(::getpid())};
    for (const char* name : {"STIPPLE_JOB_SANDBOX", "LD_LIBRARY_PATH"}) {
        if (const char* value = std::getenv(name))
            result.push_back(std::string(name) + "=" + value);
    }
    return result;
}

/// A process group of its own; killed and reaped when this ends, whatever happens.
class Child {
public:
    Child(const std::filesystem::path& program, const FileDescriptor& spec,
          const FileDescriptor& output);
    ~Child() {
        if (pid_ > 0) end();
    }
    Child(const Child&) = delete;
    Child& operator=(const Child&) = delete;

    /// Kills what still runs and returns the wait status. A process that is ending by itself
    /// already keeps its own status.
    int end() noexcept {
        ::kill(-pid_, SIGKILL);
        int status = 0;
        while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
        }
        pid_ = -1;
        return status;
    }

private:
    pid_t pid_ = -1;
};

class SpawnActions {
public:
    SpawnActions() { ::posix_spawn_file_actions_init(&actions_); }
    ~SpawnActions() { ::posix_spawn_file_actions_destroy(&actions_); }
    SpawnActions(const SpawnActions&) = delete;
    SpawnActions& operator=(const SpawnActions&) = delete;
    posix_spawn_file_actions_t* get() noexcept { return &actions_; }

private:
    posix_spawn_file_actions_t actions_{};
};

class SpawnAttributes {
public:
    SpawnAttributes() {
        // What a supervisor or a terminal sends to all processes of the service is for the server,
        // which decides what becomes of the job.
        sigset_t blocked, all;
        ::sigemptyset(&blocked);
        for (const int number : {SIGTERM, SIGINT, SIGHUP}) ::sigaddset(&blocked, number);
        ::sigfillset(&all);
        ::posix_spawnattr_init(&attributes_);
        ::posix_spawnattr_setpgroup(&attributes_, 0);
        ::posix_spawnattr_setsigmask(&attributes_, &blocked);
        ::posix_spawnattr_setsigdefault(&attributes_, &all);
        ::posix_spawnattr_setflags(
            &attributes_, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    }
    ~SpawnAttributes() { ::posix_spawnattr_destroy(&attributes_); }
    SpawnAttributes(const SpawnAttributes&) = delete;
    SpawnAttributes& operator=(const SpawnAttributes&) = delete;
    const posix_spawnattr_t* get() const noexcept { return &attributes_; }

private:
    posix_spawnattr_t attributes_{};
};

Child::Child(const std::filesystem::path& program, const FileDescriptor& spec,
             const FileDescriptor& output) {
    SpawnActions actions;
    ::posix_spawn_file_actions_addopen(actions.get(), STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    ::posix_spawn_file_actions_adddup2(actions.get(), output.get(), STDOUT_FILENO);
    ::posix_spawn_file_actions_adddup2(actions.get(), spec.get(), kSpecDescriptor);
    // Also what a library opened without close-on-exec: a job inherits no connection and no
    // database.
    ::posix_spawn_file_actions_addclosefrom_np(actions.get(), kSpecDescriptor + 1);

    const std::vector<std::string> variables = environment();
    std::vector<char*> environment_pointers;
    for (const std::string& variable : variables) {
        environment_pointers.push_back(const_cast<char*>(variable.c_str()));
    }
    environment_pointers.push_back(nullptr);
    std::string name = program.string();
    std::string spec_path = kSpecPath;
    const std::array<char*, 3> arguments = {name.data(), spec_path.data(), nullptr};

    const SpawnAttributes attributes;
    const int failed = ::posix_spawn(&pid_, program.c_str(), actions.get(), attributes.get(),
                                     arguments.data(), environment_pointers.data());
    if (failed != 0) {
        pid_ = -1;
        throw system_error("cannot start " + name, failed);
    }
}

/// Cuts what a child writes into lines, within limits.
class LineReader {
public:
    explicit LineReader(FileDescriptor input) : input_(std::move(input)) {}
    int descriptor() const noexcept { return input_.get(); }

    /// Reads what there is and calls `line` for each complete one. False at the end of the output.
    /// @throws Error(MalformedInput) over a limit.
    template <typename OnLine>
    bool read(OnLine&& on_line) {
        std::array<char, 65536> block;
        const ssize_t n = ::read(input_.get(), block.data(), block.size());
        if (n < 0) return errno == EINTR || errno == EAGAIN;
        if (n == 0) return false;
        total_ += static_cast<std::size_t>(n);
        std::string_view rest(block.data(), static_cast<std::size_t>(n));
        for (std::size_t end; (end = rest.find('\n')) != std::string_view::npos;) {
            line_ += rest.substr(0, end);
            rest.remove_prefix(end + 1);
            on_line(std::string_view(line_));
            line_.clear();
        }
        line_ += rest;
        if (line_.size() > proto::kMaxReportBytes || total_ > kMaxOutputBytes) {
            throw Error(ErrorCode::MalformedInput, "more output than a job may write");
        }
        return true;
    }

private:
    FileDescriptor input_;
    std::string line_;
    std::size_t total_ = 0;
};

std::string describe_end(int status) {
    if (WIFSIGNALED(status)) {
        const int number = WTERMSIG(status);
        const char* const likely = number == SIGKILL ? ": memory may have run out" : "";
        return "signal " + std::to_string(number) + " (" + ::strsignal(number) + ")" + likely;
    }
    return "exit status " + std::to_string(WEXITSTATUS(status)) + " without a final report";
}

/// How long a job may take by the clock on the wall: one that only waits uses no processor time.
std::optional<Clock::duration> wall_limit(const proto::JobSpec& spec) {
    constexpr std::uint64_t kLongest = 365 * 24 * 3600;
    if (spec.max_cpu_seconds == 0) return std::nullopt;
    return std::chrono::seconds(4 * std::min(spec.max_cpu_seconds, kLongest) + 60);
}

proto::JobReport out_of_time(Clock::duration limit) {
    const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(limit).count();
    return proto::problem_from(ErrorCode::TooLarge,
                               "the job did not end within " + std::to_string(seconds) +
                                   " seconds: upload a smaller cloud, or raise the limit");
}

/// The two ends of a pipe.
struct Pipe {
    FileDescriptor read_end, write_end;

    Pipe() {
        std::array<int, 2> ends{};
        if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw system_error("pipe2");
        read_end = FileDescriptor(ends[0]);
        write_end = FileDescriptor(ends[1]);
    }
};

class ProcessJobRunner : public JobRunner {
public:
    explicit ProcessJobRunner(std::filesystem::path program) : program_(std::move(program)) {}

    Outcome run(const proto::JobSpec& spec,
                const std::function<void(const proto::JobReport&)>& report,
                std::stop_token stop) override {
        StopEvent stopped;
        const std::stop_callback on_stop(std::move(stop), [&stopped] { stopped.raise(); });
        Pipe pipe;
        Child child(program_, spec_file(spec), pipe.write_end);
        pipe.write_end = FileDescriptor();  // so that the child's end is the only one left
        LineReader lines(std::move(pipe.read_end));
        return watch(child, lines, stopped, spec, report);
    }

private:
    static Outcome watch(Child& child, LineReader& lines, const StopEvent& stopped,
                         const proto::JobSpec& spec,
                         const std::function<void(const proto::JobReport&)>& report);

    const std::filesystem::path program_;
};

/// Waits for the first of output, stop and `deadline`.
enum class Wake { Output, Stop, Deadline };
Wake wait_for(const LineReader& lines, const StopEvent& stopped,
              std::optional<Clock::time_point> deadline) {
    std::array<pollfd, 2> watched = {pollfd{stopped.fd(), POLLIN, 0},
                                     pollfd{lines.descriptor(), POLLIN, 0}};
    for (;;) {
        int timeout = -1;
        if (deadline) {
            const auto left =
                std::chrono::ceil<std::chrono::milliseconds>(*deadline - Clock::now()).count();
            timeout = static_cast<int>(std::clamp<std::int64_t>(left, 0, 3'600'000));
            if (left <= 0) return Wake::Deadline;
        }
        if (::poll(watched.data(), watched.size(), timeout) < 0 && errno != EINTR) {
            throw system_error("poll");
        }
        if (watched[0].revents != 0) return Wake::Stop;
        if (watched[1].revents != 0) return Wake::Output;
    }
}

Outcome ProcessJobRunner::watch(Child& child, LineReader& lines, const StopEvent& stopped,
                                const proto::JobSpec& spec,
                                const std::function<void(const proto::JobReport&)>& report) {
    const std::optional<Clock::duration> limit = wall_limit(spec);
    const auto deadline = limit ? std::optional(Clock::now() + *limit) : std::nullopt;

    std::vector<proto::JobReport> reports;
    const auto take = [&reports](std::string_view line) {
        reports.push_back(proto::job_report_from_json(line));
    };
    for (;;) {
        const Wake wake = wait_for(lines, stopped, deadline);
        if (wake == Wake::Stop) {
            child.end();
            return {Outcome::Kind::Stopped, {}};
        }
        if (wake == Wake::Deadline) {
            child.end();
            report(out_of_time(*limit));
            return {Outcome::Kind::Finished, {}};
        }

        bool more = true;
        reports.clear();
        try {
            more = lines.read(take);
        } catch (const Error& error) {
            child.end();
            return {Outcome::Kind::Crashed, std::string("unreadable report: ") + error.what()};
        }
        for (const proto::JobReport& line : reports) {
            const bool finished = std::holds_alternative<proto::JobCost>(line) ||
                                  std::holds_alternative<proto::Problem>(line);
            if (finished) child.end();  // so that its memory is free when the result is published
            report(line);
            if (finished) return {Outcome::Kind::Finished, {}};
        }
        if (!more) return {Outcome::Kind::Crashed, describe_end(child.end())};
    }
}

}  // namespace

std::unique_ptr<JobRunner> make_process_job_runner(const std::filesystem::path& program) {
    return std::make_unique<ProcessJobRunner>(program);
}

}  // namespace stipple::server
