#include "worker/worker_pool.hpp"

#include "store/sqlite.hpp"
#include "store/store_fault.hpp"
#include "store_fixtures.hpp"

#include <atomic>
#include <cerrno>
#include <fstream>
#include <thread>

namespace stipple::server {
namespace {

using namespace stipple::test;
using namespace std::chrono_literals;
using proto::JobDocument;
using proto::JobSpec;
using proto::JobStatus;
using std::chrono::steady_clock;
using Outcome = JobRunner::Outcome;
using Kind = Outcome::Kind;

constexpr std::string_view kCloud = "ply\nthe bytes of a cloud";
constexpr const char* kNotSaid = "the service could not run the job; its log says why";

/// Waits for `condition`; the limit is only met by a failing test.
template <typename Condition>
bool becomes_true(Condition condition, std::chrono::milliseconds limit = 30s) {
    const auto deadline = steady_clock::now() + limit;
    while (!condition()) {
        if (steady_clock::now() >= deadline) return false;
        std::this_thread::sleep_for(2ms);
    }
    return true;
}

/// Writes a file as stipple-job would, and the report of it.
proto::OutputCloud make_level(const JobSpec& spec, unsigned level, const std::string& text) {
    const std::string name = "level-" + std::to_string(level) + ".ply";
    std::ofstream(std::filesystem::path(spec.output_dir) / name) << text;
    proto::OutputCloud made = level_with(level, proto::sha256_hex(bytes_of(text)));
    made.files[0].href = name;
    return made;
}

Outcome wait_until_stopped(std::stop_token stop) {
    while (!stop.stop_requested()) std::this_thread::sleep_for(1ms);
    return {Kind::Stopped, ""};
}

class WorkerPoolTest : public testing::Test {
protected:
    WorkerPoolTest() {
        const auto writer = blobs_->create(1000);
        writer->write(bytes_of(kCloud));
        writer->commit();
        input_ = put_cloud(*jobs_, "ada", kCloud);
        options_.scratch = folder_ / "scratch";
        options_.rest = 1ms;
    }

    JobDocument submit() {
        return jobs_->submit("ada", pyramid_request(input_), {}, limits_.queue).document;
    }
    JobDocument find(const JobDocument& job) { return jobs_->find_job("ada", job.id).value(); }
    JobDocument wait_for_end(const JobDocument& job) {
        EXPECT_TRUE(becomes_true([&] { return is_final(find(job).status); }));
        return find(job);
    }
    /// Runs one job to its end by a function.
    JobDocument run(FunctionRunner::Function function) {
        const JobDocument job = submit();
        FunctionRunner runner(std::move(function));
        const WorkerPool pool(options_, limits_, *jobs_, *blobs_, runner);
        return wait_for_end(job);
    }
    std::string find_running() {
        const JobStore::JobFilter running{.type = {}, .status = "running", .input = {}};
        return jobs_->list_jobs("ada", running, 1, {}).items.at(0).id;
    }
    bool scratch_is_empty() const { return std::filesystem::is_empty(options_.scratch); }

    TemporaryFolder folder_;
    std::unique_ptr<BlobStore> blobs_ = open_file_blob_store(folder_ / "blobs");
    std::unique_ptr<JobStore> jobs_ = open_sqlite_job_store(folder_ / "jobs.sqlite");
    std::string input_;
    Limits limits_;
    WorkerPoolOptions options_;
};

TEST_F(WorkerPoolTest, PublishesWhatAJobReportsAndItsSuccess) {
    const JobDocument job = run([](const JobSpec& spec, const auto& report, std::stop_token) {
        report(progress_report("decode", 10));
        report(statistics_of(1000));
        report(make_level(spec, 0, "coarse"));
        report(make_level(spec, 1, "fine"));
        report(cost_report());
        return Outcome{};
    });
    EXPECT_EQ(job.status, JobStatus::Successful);
    const auto results = jobs_->results("ada", job.id).value();
    ASSERT_EQ(results.levels.size(), 2U);
    EXPECT_EQ(results.source->points, 1000U);
    EXPECT_EQ(results.cost->total_seconds, 1);
    EXPECT_EQ(results.levels[0].files[0].bytes, 6U) << "as the file is, not as reported";
    EXPECT_EQ(text_of(*blobs_->open(results.levels[1].files[0].sha256)), "fine");
    EXPECT_TRUE(scratch_is_empty());
}

TEST_F(WorkerPoolTest, TakesAFileOfTwoLevelsOnce) {
    const JobDocument job = run([](const JobSpec& spec, const auto& report, std::stop_token) {
        proto::OutputCloud level = make_level(spec, 0, "the same");
        report(level);
        level.level = 1;  // of the file that is written already
        report(level);
        report(cost_report());
        return Outcome{};
    });
    EXPECT_EQ(job.status, JobStatus::Successful);
    EXPECT_EQ(job.levels_ready, 2U);
}

TEST_F(WorkerPoolTest, TellsTheJobItsInputItsFolderAndItsLimits) {
    limits_.max_job_memory_bytes = 123;
    limits_.max_job_cpu_seconds = 45;
    limits_.max_job_output_bytes = 678;
    limits_.decode.max_points = 9;
    options_.threads_per_job = 2;
    JobSpec told;
    std::string input;
    bool folder_is_empty = false;
    run([&](const JobSpec& spec, const auto& report, std::stop_token) {
        told = spec;
        std::getline(std::ifstream(spec.input_file), input, '\0');
        folder_is_empty = std::filesystem::is_empty(spec.output_dir);
        report(cost_report());
        return Outcome{};
    });
    EXPECT_EQ(input, kCloud);
    EXPECT_TRUE(folder_is_empty);
    EXPECT_EQ(told.max_memory_bytes, 123U);
    EXPECT_EQ(told.max_cpu_seconds, 45U);
    EXPECT_EQ(told.max_file_bytes, 678U);
    EXPECT_EQ(told.limits.max_points, 9U);
    EXPECT_EQ(told.threads, 2U);
}

TEST_F(WorkerPoolTest, KeepsTheProblemThatAJobReports) {
    const JobDocument job = run([](const JobSpec&, const auto& report, std::stop_token) {
        report(proto::problem_from(ErrorCode::MalformedInput, "line 7: no name"));
        return Outcome{};
    });
    EXPECT_EQ(job.status, JobStatus::Failed);
    EXPECT_EQ(job.problem->detail, "line 7: no name");
}

TEST_F(WorkerPoolTest, RunsACrashedJobOnceMoreAndThenNeverAgain) {
    std::atomic<int> attempts = 0;
    const JobDocument job = run([&](const JobSpec&, const auto&, std::stop_token) {
        ++attempts;
        return Outcome{Kind::Crashed, "signal 9 (Killed)"};
    });
    EXPECT_EQ(job.status, JobStatus::Failed);
    EXPECT_EQ(job.problem->detail, "the job process died twice: signal 9 (Killed)");
    EXPECT_EQ(attempts, 2);
}

TEST_F(WorkerPoolTest, LogsTheFailureOfAJobThatCrashesForGood) {
    const Log log;
    const JobDocument job = run([](const JobSpec&, const auto&, std::stop_token) {
        return Outcome{Kind::Crashed, "signal 9 (Killed)"};
    });
    const std::string line =
        "job.failed id=" + job.id + " status=500 detail=\"the job process died ";
    EXPECT_NE(log.text().find(line), std::string::npos) << log.text();
}

TEST_F(WorkerPoolTest, LogsAForeignTextAsOneField) {
    const Log log;
    run([](const JobSpec&, const auto& report, std::stop_token) {
        report(proto::problem_from(ErrorCode::MalformedInput, "x\" status=200 tenant=y"));
        return Outcome{};
    });
    const std::string field = R"(detail="x\" status=200 tenant=y")";
    EXPECT_NE(log.text().find(field), std::string::npos) << log.text();
}

TEST_F(WorkerPoolTest, TakesAJobThatEndsWithoutALastWordForCrashed) {
    const JobDocument job =
        run([](const auto&, const auto&, std::stop_token) { return Outcome{}; });
    EXPECT_EQ(job.problem->detail, "the job process died twice: it ended without a result");
}

TEST_F(WorkerPoolTest, FailsAJobWhoseFileHasAnotherHashThanReported) {
    const JobDocument job = run([](const JobSpec& spec, const auto& report, std::stop_token stop) {
        proto::OutputCloud level = make_level(spec, 0, "level");
        level.files[0].sha256 = std::string(64, '0');
        report(level);
        EXPECT_TRUE(stop.stop_requested()) << "there is nothing to go on for";
        report(cost_report());
        return Outcome{};
    });
    EXPECT_EQ(job.status, JobStatus::Failed);
    EXPECT_NE(job.problem->detail.find(kNotSaid), std::string::npos);
    EXPECT_EQ(job.levels_ready, 0U);
}

TEST_F(WorkerPoolTest, FailsAJobThatReportsATileBeforeItsParent) {
    const auto tiled = [](const JobSpec& spec, unsigned level,
                          std::optional<std::uint32_t> parent) {
        proto::OutputCloud made = make_level(spec, level, "level " + std::to_string(level));
        made.files[0].tile.emplace();
        made.files[0].tile->parent = parent;
        return made;
    };
    const auto status_after = [&](unsigned second, std::uint32_t parent) {
        const JobDocument job = run([&](const JobSpec& spec, const auto& report, std::stop_token) {
            report(tiled(spec, 1, std::nullopt));
            report(tiled(spec, second, parent));
            report(cost_report());
            return Outcome{};
        });
        return job.status;
    };
    EXPECT_EQ(status_after(2, 0), JobStatus::Successful);
    EXPECT_EQ(status_after(2, 1), JobStatus::Failed) << "its own parent";
    EXPECT_EQ(status_after(2, 9), JobStatus::Failed);
    EXPECT_EQ(status_after(0, 0), JobStatus::Failed) << "listed before the tile that came first";
    EXPECT_EQ(status_after(1, 0), JobStatus::Failed) << "in the place of that tile";
}

TEST_F(WorkerPoolTest, TakesNoFileFromOutsideTheFolderOfTheJob) {
    std::ofstream(folder_ / "secret") << "secret";
    const std::string secret = (folder_ / "secret").string();
    for (const std::string& name : {std::string("../../../secret"), secret, std::string("missing"),
                                    std::string("."), std::string()}) {
        const JobDocument job = run([&](const JobSpec&, const auto& report, std::stop_token) {
            proto::OutputCloud level = level_with(0, proto::sha256_hex(bytes_of("secret")));
            level.files[0].href = name;
            report(level);
            return Outcome{};
        });
        EXPECT_EQ(job.status, JobStatus::Failed) << name;
        EXPECT_NE(job.problem->detail.find(kNotSaid), std::string::npos) << name;
    }
    EXPECT_TRUE(std::filesystem::exists(folder_ / "secret"));
}

TEST_F(WorkerPoolTest, FailsAJobWhoseResultsTakeMoreThanTheLimit) {
    limits_.max_job_output_bytes = 10;
    const JobDocument job = run([](const JobSpec& spec, const auto& report, std::stop_token) {
        report(make_level(spec, 0, "123456"));
        report(make_level(spec, 1, "123456"));
        return Outcome{};
    });
    EXPECT_EQ(job.problem->status, 413);
    EXPECT_EQ(job.levels_ready, 1U);
}

TEST_F(WorkerPoolTest, TellsNobodyWhereTheServerHasItsFiles) {
    const JobDocument job = run([](const auto&, const auto& report, std::stop_token) {
        report(proto::problem_from(ErrorCode::Internal, "cannot read /srv/blobs/00"));
        return Outcome{};
    });
    EXPECT_EQ(job.status, JobStatus::Failed);
    EXPECT_EQ(job.problem->detail, kNotSaid);
}

TEST_F(WorkerPoolTest, SaysOfAFullDiskThatItIsFullAndNoMore) {
    const proto::StorageFull failure("scan.ply: No space left on device");
    int attempts = 0;
    const JobDocument job = run([&](const auto&, const auto& report, std::stop_token) {
        ++attempts;
        proto::Problem problem = proto::problem_from(failure);
        problem.stage = "encode";
        report(problem);
        return Outcome{};
    });
    EXPECT_EQ(attempts, 3) << "there may be room again";
    EXPECT_EQ(job.problem->detail, "storage full: the operator must free space");
    EXPECT_EQ(job.problem->status, proto::kStorageFullStatus);
    EXPECT_EQ(job.problem->stage, "encode");
    EXPECT_EQ(job.stage, "encode");
    const JobDocument broken =
        run([&](const auto&, const auto&, std::stop_token) -> Outcome { throw failure; });
    EXPECT_EQ(broken.problem->detail, job.problem->detail);
}

TEST_F(WorkerPoolTest, FinishesAJobThatFoundTheDiskFullWhenThereIsRoomAgain) {
    int attempts = 0;
    const JobDocument job = run([&](const JobSpec& spec, const auto& report, std::stop_token) {
        if (++attempts == 1) throw proto::StorageFull("No space left on device");
        report(make_level(spec, 0, "level"));
        report(cost_report());
        return Outcome{};
    });
    EXPECT_EQ(job.status, JobStatus::Successful);
    EXPECT_EQ(attempts, 2);
}

TEST_F(WorkerPoolTest, TriesAJobAgainThatTheSystemRefusedToRun) {
    int attempts = 0;
    const JobDocument job = run([&](const auto&, const auto& report, std::stop_token) {
        ++attempts;
        if (attempts == 1) throw std::system_error(ENOENT, std::generic_category(), "program");
        if (attempts == 2) throw StoreFault("database is locked");
        report(cost_report());
        return Outcome{};
    });
    EXPECT_EQ(job.status, JobStatus::Successful);
    EXPECT_EQ(attempts, 3);
    const JobDocument full = run([&](const auto&, const auto&, std::stop_token) -> Outcome {
        throw std::system_error(ENOSPC, std::generic_category(), "no more names");
    });
    EXPECT_EQ(full.problem->status, proto::kStorageFullStatus);
}

TEST_F(WorkerPoolTest, FailsAJobWhoseInputIsMissing) {
    blobs_->remove_older(input_, std::chrono::system_clock::now() + 1h);
    const JobDocument job =
        run([](const auto&, const auto&, std::stop_token) -> Outcome { throw Cancelled(); });
    EXPECT_EQ(job.problem->status, 404);
    EXPECT_NE(job.problem->detail.find("upload the cloud again"), std::string::npos);
}

TEST_F(WorkerPoolTest, TriesAnotherJobBeforeTheOneThatWasPutOff) {
    options_.rest = 1s;
    std::vector<std::uint64_t> tried;  // by their points
    std::atomic<bool> both = false;
    FunctionRunner runner([&](const JobSpec& spec, const auto&, std::stop_token) -> Outcome {
        tried.push_back(*std::get<proto::SimplifyJob>(spec.request.job).options.points);
        both = tried.size() == 2;
        throw StoreFault("the fault of one job, as it may be");
    });
    for (const std::uint64_t points : {1, 2})
        jobs_->submit("ada", simplify_request(input_, points), {}, limits_.queue);
    {
        const WorkerPool pool(options_, limits_, *jobs_, *blobs_, runner);
        EXPECT_TRUE(becomes_true([&] { return both.load(); }));
    }
    EXPECT_EQ(tried, (std::vector<std::uint64_t>{1, 2}));
}

TEST_F(WorkerPoolTest, GoesOnAfterAJobThatBreaksItsRunner) {
    FunctionRunner runner([](const JobSpec& spec, const auto& report, std::stop_token) {
        const bool first = proto::type_name(spec.request) == "pyramid";
        if (first) throw std::runtime_error("no more processes");
        report(cost_report());
        return Outcome{};
    });
    const WorkerPool pool(options_, limits_, *jobs_, *blobs_, runner);
    const JobDocument broken = wait_for_end(submit());
    EXPECT_EQ(broken.problem->status, 500);
    EXPECT_EQ(broken.problem->detail.find("no more processes"), std::string::npos);
    const JobDocument next =
        jobs_->submit("ada", simplify_request(input_), {}, limits_.queue).document;
    EXPECT_EQ(wait_for_end(next).status, JobStatus::Successful);
}

TEST_F(WorkerPoolTest, StartsASubmittedJobAtOnce) {
    FunctionRunner runner([](const JobSpec&, const auto& report, std::stop_token) {
        report(cost_report());
        return Outcome{};
    });
    const WorkerPool pool(options_, limits_, *jobs_, *blobs_, runner);
    std::this_thread::sleep_for(50ms);
    const auto start = steady_clock::now();
    wait_for_end(submit());
    EXPECT_LT(steady_clock::now() - start, 900ms) << "an idle worker looks once a second";
}

TEST_F(WorkerPoolTest, RunsAsManyJobsAtATimeAsItHasWorkers) {
    options_.workers = 3;
    std::atomic<int> running = 0;
    std::atomic<int> most = 0;
    FunctionRunner runner([&](const JobSpec&, const auto& report, std::stop_token) {
        const int now = ++running;
        for (int seen = most; now > seen && !most.compare_exchange_weak(seen, now);) {
        }
        becomes_true([&] { return most == 3; });
        --running;
        report(cost_report());
        return Outcome{};
    });
    std::vector<JobDocument> submitted;
    for (int i = 0; i < 6; ++i) submitted.push_back(submit());
    const WorkerPool pool(options_, limits_, *jobs_, *blobs_, runner);
    for (const JobDocument& job : submitted) wait_for_end(job);
    EXPECT_EQ(most, 3);
}

TEST_F(WorkerPoolTest, StopsADismissedJobAtOnce) {
    std::atomic<bool> started = false;
    std::atomic<bool> stopped = false;
    steady_clock::time_point stopped_at;
    FunctionRunner runner([&](const JobSpec&, const auto&, std::stop_token stop) {
        started = true;
        const Outcome outcome = wait_until_stopped(stop);
        stopped_at = steady_clock::now();
        stopped = true;
        return outcome;
    });
    const WorkerPool pool(options_, limits_, *jobs_, *blobs_, runner);
    const JobDocument job = submit();
    ASSERT_TRUE(becomes_true([&] { return started.load(); }));
    const auto dismissed_at = steady_clock::now();
    jobs_->dismiss("ada", job.id);
    ASSERT_TRUE(becomes_true([&] { return stopped.load(); }));
    // 100 ms are promised; the bound allows for a loaded machine.
    EXPECT_LT(stopped_at - dismissed_at, 1s);
    RecordProperty("milliseconds", std::to_string((stopped_at - dismissed_at) / 1ms));
    EXPECT_EQ(find(job).status, JobStatus::Dismissed);
}

TEST_F(WorkerPoolTest, StopsAJobWhoseReportIsRefused) {
    const JobDocument job = run([&](const JobSpec&, const auto& report, std::stop_token stop) {
        jobs_->dismiss("ada", find_running());
        report(progress_report("decode", 50));
        EXPECT_TRUE(stop.stop_requested());
        report(cost_report());
        return Outcome{Kind::Stopped, ""};
    });
    EXPECT_EQ(job.status, JobStatus::Dismissed);
}

TEST_F(WorkerPoolTest, RenewsTheLeaseOfALongJob) {
    options_.lease = 1s;
    std::atomic<int> attempts = 0;
    const JobDocument job = run([&](const JobSpec&, const auto& report, std::stop_token stop) {
        ++attempts;
        const auto end = steady_clock::now() + 2500ms;
        while (steady_clock::now() < end && !stop.stop_requested())
            std::this_thread::sleep_for(5ms);
        report(cost_report());
        return Outcome{};
    });
    EXPECT_EQ(job.status, JobStatus::Successful);
    EXPECT_EQ(attempts, 1);
}

TEST_F(WorkerPoolTest, RunsALostJobAgainBesideTheAttemptThatStillEnds) {
    options_.workers = 2;
    std::atomic<unsigned> begun = 0;
    std::filesystem::path first;
    const JobDocument job =
        run([&](const JobSpec& spec, const auto& report, const std::stop_token& stop) {
            if (begun++ == 0) {
                first = spec.output_dir;
                sqlite::Connection(folder_ / "jobs.sqlite")
                    .run("UPDATE jobs SET lease_until = 0");  // as if its worker had slept
                return wait_until_stopped(stop);
            }
            EXPECT_TRUE(becomes_true([&] { return !std::filesystem::exists(first); }));
            report(make_level(spec, 0, "coarse"));
            report(cost_report());
            return Outcome{};
        });
    EXPECT_EQ(job.status, JobStatus::Successful);
    EXPECT_EQ(begun, 2U);
}

TEST_F(WorkerPoolTest, LetsARunningJobEndBeforeItEnds) {
    std::atomic<bool> started = false;
    const JobDocument job = submit();
    {
        FunctionRunner runner([&](const JobSpec&, const auto& report, std::stop_token) {
            started = true;
            std::this_thread::sleep_for(200ms);
            report(cost_report());
            return Outcome{};
        });
        const WorkerPool pool(options_, limits_, *jobs_, *blobs_, runner);
        ASSERT_TRUE(becomes_true([&] { return started.load(); }));
    }
    EXPECT_EQ(find(job).status, JobStatus::Successful);
}

TEST_F(WorkerPoolTest, TakesNoJobOnceItDrainsAndFinishesTheOnesUnderWay) {
    std::atomic<bool> started = false, released = false;
    const JobDocument running = submit();
    JobDocument late;
    {
        FunctionRunner runner([&](const JobSpec&, const auto& report, std::stop_token) {
            started = true;
            becomes_true([&] { return released.load(); });
            report(cost_report());
            return Outcome{};
        });
        options_.workers = 2;
        WorkerPool pool(options_, limits_, *jobs_, *blobs_, runner);
        ASSERT_TRUE(becomes_true([&] { return started.load(); }));
        pool.begin_drain();
        late = submit();
        std::this_thread::sleep_for(50ms);  // in which an idle worker would take it
        EXPECT_EQ(find(running).status, JobStatus::Running);
        released = true;
    }
    EXPECT_EQ(find(running).status, JobStatus::Successful);
    EXPECT_EQ(find(late).status, JobStatus::Accepted);
}

TEST_F(WorkerPoolTest, LeavesWhatItDidNotMakeInItsScratchFolder) {
    std::filesystem::create_directories(options_.scratch / "results");
    std::ofstream(options_.scratch / "results/thesis.txt") << "work";
    run([](const JobSpec&, const auto& report, std::stop_token) {
        report(cost_report());
        return Outcome{};
    });
    EXPECT_TRUE(std::filesystem::exists(options_.scratch / "results/thesis.txt"));
}

TEST_F(WorkerPoolTest, HandsAJobBackThatTakesLongerThanTheDrain) {
    options_.drain = 0s;
    std::atomic<bool> started = false;
    const JobDocument job = submit();
    {
        FunctionRunner runner([&](const JobSpec&, const auto&, std::stop_token stop) {
            started = true;
            return wait_until_stopped(stop);
        });
        const WorkerPool pool(options_, limits_, *jobs_, *blobs_, runner);
        ASSERT_TRUE(becomes_true([&] { return started.load(); }));
    }
    EXPECT_EQ(find(job).status, JobStatus::Accepted);
    EXPECT_TRUE(scratch_is_empty());
}

TEST_F(WorkerPoolTest, RunsAgainWhatARestartInterrupted) {
    const JobDocument job = submit();
    ASSERT_TRUE(jobs_->claim(limits_.queue, 3600s));
    jobs_.reset();
    jobs_ = open_sqlite_job_store(folder_ / "jobs.sqlite");
    jobs_->recover();
    const std::filesystem::path left = options_.scratch / (job.id + "-1");
    std::filesystem::create_directories(left / "output");
    std::ofstream(left / "output/left.ply") << "left behind";
    bool folder_is_empty = false;
    FunctionRunner runner([&](const JobSpec& spec, const auto& report, std::stop_token) {
        folder_is_empty = std::filesystem::is_empty(spec.output_dir);
        report(cost_report());
        return Outcome{};
    });
    const WorkerPool pool(options_, limits_, *jobs_, *blobs_, runner);
    EXPECT_EQ(wait_for_end(job).status, JobStatus::Successful);
    EXPECT_TRUE(folder_is_empty);
    EXPECT_FALSE(std::filesystem::exists(left / "output/left.ply"));
}

}  // namespace
}  // namespace stipple::server
