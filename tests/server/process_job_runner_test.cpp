// The real stipple-job under the real runner.

#include "stipple/proto/digest.hpp"
#include "support/stippled_process.hpp"
#include "support/support.hpp"
#include "worker/worker_pool.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <string>
#include <system_error>
#include <thread>

namespace stipple::server {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
using Kind = JobRunner::Outcome::Kind;

std::vector<pid_t> children() {
    return test::children_of(::getpid());
}

class ProcessJobRunner : public testing::Test {
protected:
    ProcessJobRunner() { fs::create_directory(folder_ / "out"); }
    ~ProcessJobRunner() override { EXPECT_TRUE(children().empty()) << "a child was not reaped"; }

    proto::JobSpec spec_for(const fs::path& input, std::uint64_t points = 100) {
        proto::SimplifyJob job;
        job.options.points = points;
        job.output.formats = {CloudFormat::Ply};
        return {.request = {std::string(64, 'a'), job},
                .input_file = input,
                .output_dir = folder_ / "out",
                .limits = {},
                .max_memory_bytes = 1ULL << 30,
                .max_cpu_seconds = 60,
                .max_file_bytes = 1 << 30,
                .threads = 2};
    }

    fs::path sphere_file(std::size_t points) {
        const fs::path file = folder_ / "in.ply";
        write_cloud(test::sphere(points), file, {}, {}, {}, {.threads = 1});
        return file;
    }

    /// A job that is busy for seconds.
    proto::JobSpec long_job() {
        const std::size_t points = test::kSanitized ? 300'000 : 2'000'000;
        proto::JobSpec spec = spec_for(sphere_file(points), points - 1);
        spec.threads = 1;
        return spec;
    }

    fs::path script(const std::string& body) {
        const fs::path file = folder_ / "script";
        std::ofstream(file) << "#!/bin/sh\n" << body << '\n';
        fs::permissions(file, fs::perms::owner_all);
        return file;
    }

    JobRunner::Outcome run(const proto::JobSpec& spec, std::stop_token stop = {},
                           const fs::path& program = test::program("stipple-job")) {
        return make_process_job_runner(program)->run(
            spec,
            [this](const proto::JobReport& report) {
                reports_.push_back(report);
                if (on_report_) on_report_();
            },
            std::move(stop));
    }

    /// The last report, where that is a problem.
    std::optional<proto::Problem> problem() const {
        const auto* const last = std::get_if<proto::Problem>(&reports_.back());
        return last != nullptr ? std::optional(*last) : std::nullopt;
    }
    bool succeeded() const { return std::holds_alternative<proto::JobCost>(reports_.back()); }

    test::TemporaryFolder folder_;
    std::vector<proto::JobReport> reports_;
    std::function<void()> on_report_;
};

TEST_F(ProcessJobRunner, DoesAJobToItsLastReport) {
    const auto outcome = run(spec_for(sphere_file(2000)));
    EXPECT_EQ(outcome.kind, Kind::Finished) << outcome.how;
    ASSERT_TRUE(succeeded()) << problem().value_or(proto::Problem{}).detail;
    EXPECT_EQ(read_cloud(folder_ / "out" / "level-0.ply").size(), 100U);
}

TEST_F(ProcessJobRunner, ReportsTheProblemOfAMalformedFileWithItsStage) {
    const fs::path file = folder_ / "bad.ply";
    std::ofstream(file) << "ply\nformat ascii 1.0\nelement vertex lots\nend_header\n";
    EXPECT_EQ(run(spec_for(file)).kind, Kind::Finished);
    ASSERT_TRUE(problem());
    EXPECT_EQ(problem()->status, 422) << problem()->detail;
    EXPECT_EQ(problem()->stage, "decode");
}

TEST_F(ProcessJobRunner, ReportsTheProblemOfAFileThatIsNotThere) {
    EXPECT_EQ(run(spec_for("/no/such/file")).kind, Kind::Finished);
    ASSERT_TRUE(problem());
    EXPECT_NE(problem()->detail.find("/no/such/file"), std::string::npos) << problem()->detail;
}

class DracoBomb : public ProcessJobRunner, public testing::WithParamInterface<const char*> {};

TEST_P(DracoBomb, EndsItsJobWithAProblemInUnderTwoSeconds) {
    if (test::kSanitized) GTEST_SKIP() << "a sanitizer's build runs without limits";
    proto::JobSpec spec = spec_for(test::data_file("bad") / GetParam());
    spec.max_memory_bytes = 512 << 20;
    const auto start = Clock::now();
    const auto outcome = run(spec);
    EXPECT_LT(Clock::now() - start, 2s);
    EXPECT_EQ(outcome.kind, Kind::Finished) << outcome.how;
    ASSERT_TRUE(problem());
    EXPECT_TRUE(problem()->status == 413 || problem()->status == 422) << problem()->detail;
    EXPECT_EQ(problem()->stage, "decode");
    if (problem()->status == 413) {
        EXPECT_NE(problem()->detail.find("536870912 bytes"), std::string::npos)
            << problem()->detail;
    }
}

INSTANTIATE_TEST_SUITE_P(Bad, DracoBomb,
                         testing::Values("bomb_sequential.drc", "bomb_quantized.drc",
                                         "bomb_kd_tree.drc"));

TEST_F(ProcessJobRunner, NamesTheMemoryLimitThatWasTooSmall) {
    if (test::kSanitized) GTEST_SKIP() << "a sanitizer's build runs without limits";
    proto::JobSpec spec = spec_for(sphere_file(2'000'000));
    spec.max_memory_bytes = 32 << 20;
    spec.threads = 1;
    const auto outcome = run(spec);
    EXPECT_EQ(outcome.kind, Kind::Finished) << outcome.how;
    ASSERT_TRUE(problem());
    EXPECT_EQ(problem()->status, 413);
    EXPECT_NE(problem()->detail.find("more than the 33554432 bytes of memory"), std::string::npos)
        << problem()->detail;
}

TEST_F(ProcessJobRunner, NamesTheMemoryLimitThatWasTooSmallForItsThreads) {
    if (test::kSanitized) GTEST_SKIP() << "a sanitizer's build runs without limits";
    proto::JobSpec spec = spec_for(sphere_file(200'000));
    spec.max_memory_bytes = 512 << 20;
    spec.threads = 1024;  // whose stacks take 4 GiB
    const auto outcome = run(spec);
    EXPECT_EQ(outcome.kind, Kind::Finished) << outcome.how;
    ASSERT_TRUE(problem());
    EXPECT_EQ(problem()->status, 413) << problem()->detail;
}

TEST_F(ProcessJobRunner, HasRoomForAsManyThreadsAsMayBeAskedFor) {
    proto::JobSpec spec = spec_for(sphere_file(200'000));
    spec.threads = 1024;
    Limits limits;
    limits.max_job_memory_bytes = 16ULL << 30;
    spec.max_memory_bytes = limits.memory_for(fs::file_size(spec.input_file), spec.threads);
    const auto outcome = run(spec);
    EXPECT_EQ(outcome.kind, Kind::Finished) << outcome.how;
    EXPECT_TRUE(succeeded()) << problem().value_or(proto::Problem{}).detail;
}

TEST_F(ProcessJobRunner, NamesTheProcessorTimeThatWasTooShort) {
    proto::JobSpec spec = long_job();
    spec.max_cpu_seconds = 1;
    const auto outcome = run(spec);
    EXPECT_EQ(outcome.kind, Kind::Finished) << outcome.how;
    ASSERT_TRUE(problem());
    EXPECT_EQ(problem()->status, 413);
    EXPECT_NE(problem()->detail.find("limit of 1 seconds of processor time"), std::string::npos)
        << problem()->detail;
}

TEST_F(ProcessJobRunner, NamesTheFileLimitThatWasTooSmall) {
    proto::JobSpec spec = spec_for(sphere_file(5000), 5000);
    spec.max_file_bytes = 10'000;
    EXPECT_EQ(run(spec).kind, Kind::Finished);
    ASSERT_TRUE(problem());
    EXPECT_EQ(problem()->status, 413);
    EXPECT_NE(problem()->detail.find("10000 bytes per file"), std::string::npos)
        << problem()->detail;
    EXPECT_FALSE(fs::exists(folder_ / "out" / "level-0.ply"));
}

TEST_F(ProcessJobRunner, ReturnsWithinAHundredMillisecondsOfAStop) {
    std::stop_source stop;
    std::optional<Clock::time_point> asked;
    std::jthread stopper;
    on_report_ = [&] {  // once it computes
        const auto* const progress = std::get_if<proto::JobProgress>(&reports_.back());
        if (stopper.joinable() || progress == nullptr || progress->stage != "simplify") return;
        stopper = std::jthread([&] {
            asked = Clock::now();
            stop.request_stop();
        });
    };
    const proto::JobSpec spec = long_job();
    const auto outcome = run(spec, stop.get_token());
    const auto returned = Clock::now();
    stopper.join();
    EXPECT_EQ(outcome.kind, Kind::Stopped);
    ASSERT_TRUE(asked);
    EXPECT_LT(returned - *asked, 100ms);
}

TEST_F(ProcessJobRunner, StopsAtOnceWhenTheStopCameFirst) {
    std::stop_source stop;
    stop.request_stop();
    EXPECT_EQ(run(spec_for(sphere_file(1000)), stop.get_token()).kind, Kind::Stopped);
}

TEST_F(ProcessJobRunner, KillsAChildThatDoesNotHearTheStop) {
    std::stop_source stop;
    stop.request_stop();
    const auto start = Clock::now();
    const auto outcome =
        run(spec_for("x"), stop.get_token(), script("trap '' TERM; while :; do :; done"));
    EXPECT_EQ(outcome.kind, Kind::Stopped);
    EXPECT_LT(Clock::now() - start, 1s);
}

TEST_F(ProcessJobRunner, TellsTheSignalThatKilledAChild) {
    on_report_ = [] {
        for (const pid_t child : children()) ::kill(child, SIGKILL);
    };
    const auto outcome = run(long_job());
    EXPECT_EQ(outcome.kind, Kind::Crashed);
    EXPECT_EQ(outcome.how, "signal 9 (Killed): memory may have run out");
}

TEST_F(ProcessJobRunner, LeavesWhatASupervisorSendsToAllProcessesToTheServer) {
    bool sent = false;
    on_report_ = [&] {
        for (const pid_t child : children())
            for (const int number : {SIGTERM, SIGINT, SIGHUP})
                sent = ::kill(child, number) == 0 || sent;
    };
    const auto outcome = run(spec_for(sphere_file(200'000)));
    EXPECT_TRUE(sent);
    EXPECT_EQ(outcome.kind, Kind::Finished) << outcome.how;
    EXPECT_TRUE(succeeded());
}

TEST_F(ProcessJobRunner, HasTheKernelEndAJobFirstWhereMemoryRunsOut) {
    int score = 0;
    on_report_ = [&] {
        for (const pid_t child : children()) {
            std::ifstream("/proc/" + std::to_string(child) + "/oom_score_adj") >> score;
            ::kill(child, SIGKILL);
        }
    };
    run(long_job());
    EXPECT_EQ(score, 1000);
}

TEST_F(ProcessJobRunner, TellsTheStatusOfAChildThatEndedWithoutALastWord) {
    const auto outcome = run(spec_for("x"), {}, script("exit 3"));
    EXPECT_EQ(outcome.kind, Kind::Crashed);
    EXPECT_EQ(outcome.how, "exit status 3 without a final report");
}

TEST_F(ProcessJobRunner, BelievesNothingButReports) {
    const auto outcome = run(spec_for("x"), {}, script("echo '{\"cost\": 1}'; exec sleep 100"));
    EXPECT_EQ(outcome.kind, Kind::Crashed);
    EXPECT_EQ(outcome.how, "unreadable report: cost: 1: expected an object");
}

TEST_F(ProcessJobRunner, CutsALineWithoutEnd) {
    const auto outcome = run(spec_for("x"), {}, script("exec cat /dev/zero"));
    EXPECT_EQ(outcome.kind, Kind::Crashed);
    EXPECT_EQ(outcome.how, "unreadable report: more output than a job may write");
}

TEST_F(ProcessJobRunner, GivesAJobNothingButItsSpecificationAndOutput) {
    ::setenv("STIPPLE_SECRET", "key", 1);
    // Without close-on-exec, as a careless library opens a file.
    const int inherited = ::fcntl(STDIN_FILENO, F_DUPFD, 50);
    ASSERT_GE(inherited, 50);
    const fs::path seen = folder_ / "seen";
    run(spec_for("x"), {},
        script("(env; ls /proc/$$/fd) > " + seen.string() + "; cat \"$1\" >> " + seen.string()));
    ::close(inherited);
    ::unsetenv("STIPPLE_SECRET");
    std::ifstream in(seen);
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    EXPECT_NE(text.find("\"input_file\":\"x\""), std::string::npos) << text;
    EXPECT_EQ(text.find("STIPPLE_SECRET"), std::string::npos) << text;
    EXPECT_EQ(text.find("\n" + std::to_string(inherited) + "\n"), std::string::npos) << text;
}

TEST_F(ProcessJobRunner, RunsAJobBehindAFilterOfSystemCallsAndUnderItsLimits) {
    if (test::kSanitized) GTEST_SKIP() << "a sanitizer's build runs without limits";
    std::string status, limits;
    std::stop_source stop;
    on_report_ = [&] {
        if (!status.empty()) return;
        const std::string process = "/proc/" + std::to_string(children().at(0));
        const auto read = [&process](const char* name) {
            std::ifstream in(process + name);
            return std::string{std::istreambuf_iterator<char>(in), {}};
        };
        status = read("/status");
        limits = read("/limits");
        stop.request_stop();  // the first report already comes from inside
    };
    run(long_job(), stop.get_token());
    EXPECT_NE(status.find("Seccomp:\t2"), std::string::npos) << status;
    EXPECT_NE(status.find("NoNewPrivs:\t1"), std::string::npos) << status;
    EXPECT_NE(limits.find("Max core file size        0 "), std::string::npos) << limits;
    EXPECT_NE(limits.find("Max file size             1073741824 "), std::string::npos) << limits;
    EXPECT_NE(limits.find("Max cpu time              60 "), std::string::npos) << limits;
}

TEST_F(ProcessJobRunner, SaysWhichProgramCannotBeStarted) {
    try {
        run(spec_for("x"), {}, "/no/such/program");
        FAIL() << "no error";
    } catch (const std::system_error& error) {
        EXPECT_NE(std::string(error.what()).find("/no/such/program"), std::string::npos);
    }
}

TEST_F(ProcessJobRunner, EndsTheChildWhenAReportCannotBeKept) {
    on_report_ = [] { throw std::runtime_error("the store is gone"); };
    const proto::JobSpec spec = long_job();
    EXPECT_THROW(run(spec), std::runtime_error);
}

}  // namespace
}  // namespace stipple::server
