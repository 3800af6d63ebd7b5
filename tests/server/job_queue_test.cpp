#include "job_store_contract.hpp"

#include <algorithm>
#include <map>
#include <mutex>

namespace stipple::server {
namespace {

using namespace stipple::test;
using namespace std::chrono_literals;
using proto::JobDocument;
using proto::JobStatus;

/// The side of a job store that workers see.
class JobQueueContract : public JobStoreContract {};

const proto::Problem kProblem = proto::problem_from(ErrorCode::MalformedInput, "line 7: no name");

TEST_P(JobQueueContract, GivesTheOldestJobFirst) {
    const JobDocument first = submit();
    const JobDocument second = submit();
    EXPECT_EQ(claim().job_id, first.id);
    EXPECT_EQ(claim().job_id, second.id);
    EXPECT_FALSE(store_->claim(limits_, 60s));
}

TEST_P(JobQueueContract, GivesTheTenantWithTheFewestRunningJobsItsTurn) {
    for (int i = 0; i < 10; ++i) submit("ada");
    EXPECT_EQ(claim().tenant, "ada");
    submit("bob");
    EXPECT_EQ(claim().tenant, "bob");
    EXPECT_EQ(claim().tenant, "ada");
}

TEST_P(JobQueueContract, LetsTenantsTakeTurnsAtOneWorker) {
    for (int i = 0; i < 3; ++i) submit("ada");
    for (const char* tenant : {"bob", "eve"}) submit(tenant);
    std::string turns;
    while (const auto lease = store_->claim(limits_, 60s)) {
        turns += lease->tenant + ' ';
        store_->succeed(*lease, {});
    }
    EXPECT_EQ(turns, "ada bob eve ada ada ");
}

TEST_P(JobQueueContract, RunsNoMoreJobsOfATenantThanItsLimit) {
    limits_.max_running = 1;
    submit();
    submit();
    const Lease lease = claim();
    EXPECT_FALSE(store_->claim(limits_, 60s));
    store_->succeed(lease, {});
    EXPECT_TRUE(store_->claim(limits_, 60s));
}

TEST_P(JobQueueContract, GivesEachOfAThousandJobsToOneOfEightThreads) {
    limits_.max_running = 2000;
    const auto request = simplify_request(put_cloud(*store_, "ada", "cloud"));
    for (int i = 0; i < 1000; ++i) store_->submit("ada", request, {}, limits_);
    std::mutex mutex;
    std::map<std::string, int> claims;
    std::vector<std::jthread> threads;
    for (int i = 0; i < 8; ++i) {
        threads.emplace_back([&] {
            while (const auto lease = store_->claim(limits_, 600s)) {
                const std::lock_guard lock(mutex);
                ++claims[lease->job_id];
            }
        });
    }
    threads.clear();
    EXPECT_EQ(claims.size(), 1000U);
    EXPECT_TRUE(std::ranges::all_of(claims, [](const auto& claim) { return claim.second == 1; }));
}

TEST_P(JobQueueContract, TellsTheLifeOfAJobInOrder) {
    const JobDocument job = submit();
    const Lease lease = claim();
    EXPECT_EQ(find(job.id).status, JobStatus::Running);
    EXPECT_NE(find(job.id).started, "");
    EXPECT_TRUE(store_->report_progress(lease, "decode", 10));
    EXPECT_TRUE(store_->report_source(lease, statistics_of(1000)));
    EXPECT_TRUE(store_->publish_level(lease, level_with(0, kHash)));
    EXPECT_EQ(find(job.id).levels_ready, 1U);
    EXPECT_TRUE(store_->succeed(lease, {.total_seconds = 2}));

    const JobDocument done = find(job.id);
    EXPECT_EQ(done.status, JobStatus::Successful);
    EXPECT_EQ(done.progress, 100);
    EXPECT_EQ(done.stage, "done");
    EXPECT_NE(done.finished, "");
    EXPECT_EQ(events(job.id), (std::vector<std::string>{
                                  R"({"status":"accepted"})", R"({"status":"running"})", "progress",
                                  "source", "level", R"({"status":"successful"})"}));
    const auto numbered = store_->events_after("ada", job.id, 4);
    ASSERT_EQ(numbered.size(), 2U);
    EXPECT_EQ(numbered[0].id, 5U);
    EXPECT_EQ(
        std::get<proto::OutputCloud>(proto::job_report_from_json(numbered[0].data)).files[0].sha256,
        kHash);
    EXPECT_EQ(store_->find_cloud("ada", job.request.input)->statistics->points, 1000U);
}

TEST_P(JobQueueContract, ShowsResultsWhileTheyComeAndWhenTheyAreComplete) {
    const JobDocument job = submit();
    const Lease lease = claim();
    EXPECT_TRUE(store_->results("ada", job.id)->levels.empty());
    store_->publish_level(lease, level_with(1, std::string(64, 'b'), 20));
    store_->publish_level(lease, level_with(0, kHash, 10));
    auto results = store_->results("ada", job.id).value();
    EXPECT_FALSE(results.complete);
    EXPECT_FALSE(results.cost);
    store_->report_source(lease, statistics_of(1000));
    store_->succeed(lease, {.total_seconds = 2});
    reopen();
    results = store_->results("ada", job.id).value();
    EXPECT_TRUE(results.complete);
    EXPECT_EQ(results.cost->total_seconds, 2);
    EXPECT_EQ(results.source->points, 1000U);
    ASSERT_EQ(results.levels.size(), 2U);
    EXPECT_EQ(results.levels[0].points, 10U) << "coarsest first";
    EXPECT_EQ(results.levels[1].points, 20U);
}

TEST_P(JobQueueContract, NeverLetsProgressDecrease) {
    const JobDocument job = submit();
    const Lease lease = claim();
    store_->report_progress(lease, "decode", 40);
    std::this_thread::sleep_for(260ms);
    store_->report_progress(lease, "simplify", 20);
    EXPECT_EQ(find(job.id).progress, 40);
    EXPECT_EQ(find(job.id).stage, "simplify");
    std::this_thread::sleep_for(260ms);
    store_->report_progress(lease, "simplify", 2000);
    EXPECT_EQ(find(job.id).progress, 100);
}

TEST_P(JobQueueContract, ThinsOutProgress) {
    const JobDocument job = submit();
    const Lease lease = claim();
    for (int i = 0; i < 1000; ++i) {
        ASSERT_TRUE(store_->report_progress(lease, i % 2 ? "decode" : "clean", i * 0.1));
    }
    // 250 ms apart, beside the first; a slow machine may take seconds for the loop.
    EXPECT_LT(events(job.id).size(), 50U);
    EXPECT_GE(events(job.id).size(), 3U);
}

TEST_P(JobQueueContract, KeepsTheProblemOfAFailedJob) {
    const JobDocument job = submit();
    EXPECT_TRUE(store_->fail(claim(), kProblem));
    const JobDocument failed = find(job.id);
    EXPECT_EQ(failed.status, JobStatus::Failed);
    EXPECT_EQ(failed.problem->detail, "line 7: no name");
    EXPECT_EQ(failed.problem->status, kProblem.status);
    EXPECT_FALSE(store_->results("ada", job.id)->complete);
}

TEST_P(JobQueueContract, TakesNoWriteUnderALeaseThatAnotherHoldsNow) {
    const JobDocument job = submit();
    const Lease stale = claim_for_a_moment();
    const Lease good = claim();
    EXPECT_EQ(good.job_id, stale.job_id);
    EXPECT_GT(good.token, stale.token);
    const std::string before = to_json(find(job.id));
    const std::size_t told = events(job.id).size();

    EXPECT_FALSE(store_->holds(stale));
    EXPECT_FALSE(store_->renew(stale, 60s));
    EXPECT_FALSE(store_->report_progress(stale, "encode", 90));
    EXPECT_FALSE(store_->report_source(stale, statistics_of(1)));
    EXPECT_FALSE(store_->publish_level(stale, level_with(0, kHash)));
    EXPECT_FALSE(store_->succeed(stale, {}));
    EXPECT_FALSE(store_->fail(stale, kProblem));
    EXPECT_FALSE(store_->crashed(stale, "signal 9 (Killed)"));
    EXPECT_FALSE(store_->ran_out_of_room(stale, kProblem));
    EXPECT_FALSE(store_->put_off(stale, kProblem, 0ms));
    store_->still_no_room(0ms, kProblem);  // it waits for none
    EXPECT_FALSE(store_->release(stale));

    EXPECT_EQ(to_json(find(job.id)), before);
    EXPECT_EQ(events(job.id).size(), told);
    EXPECT_FALSE(store_->find_cloud("ada", job.request.input)->statistics);
    EXPECT_TRUE(store_->holds(good));
    EXPECT_TRUE(store_->succeed(good, {}));
}

TEST_P(JobQueueContract, FailsAJobThatIsPutOffForTheTenthTime) {
    const JobDocument job = submit();
    for (int i = 0; i < 9; ++i) {
        EXPECT_TRUE(store_->put_off(claim(), kProblem, 0ms));
        EXPECT_EQ(find(job.id).message, "the service could not run it: waiting to try again");
        store_->still_no_room(0ms, kProblem);  // it waits for none
    }
    EXPECT_TRUE(store_->put_off(claim(), kProblem, 0ms));
    EXPECT_EQ(find(job.id).status, JobStatus::Failed);
    EXPECT_EQ(find(job.id).problem->detail, kProblem.detail);
}

TEST_P(JobQueueContract, LetsAJobRestThatIsPutOff) {
    const JobDocument put_off = submit(), next = submit();
    EXPECT_TRUE(store_->put_off(claim(), kProblem, 60s));
    const Lease lease = claim();
    EXPECT_EQ(lease.job_id, next.id);
    EXPECT_FALSE(store_->claim(limits_, 60s));
    EXPECT_TRUE(store_->put_off(lease, kProblem, 0ms));
    EXPECT_EQ(claim().job_id, next.id);
}

TEST_P(JobQueueContract, FailsAJobThatWaitsForRoomForTooLong) {
    const JobDocument job = submit(), other = submit("grace");
    EXPECT_TRUE(store_->ran_out_of_room(claim(), kProblem));
    EXPECT_EQ(find(job.id).message, "the disk was full: waiting for room");
    store_->still_no_room(60s, kProblem);  // it has not rested yet
    store_->still_no_room(0ms, kProblem);
    EXPECT_EQ(find(job.id).status, JobStatus::Accepted);
    store_->still_no_room(0ms, kProblem);
    EXPECT_EQ(find(job.id).status, JobStatus::Failed);
    EXPECT_EQ(find(job.id).problem->detail, kProblem.detail);
    EXPECT_EQ(claim().job_id, other.id);  // which waits for a worker alone
}

TEST_P(JobQueueContract, TakesNoWriteOfADismissedJob) {
    const JobDocument job = submit();
    const Lease lease = claim();
    EXPECT_EQ(store_->dismiss("ada", job.id)->status, JobStatus::Dismissed);
    EXPECT_FALSE(store_->holds(lease));
    EXPECT_FALSE(store_->publish_level(lease, level_with(0, kHash)));
    EXPECT_FALSE(store_->succeed(lease, {}));
    EXPECT_FALSE(store_->crashed(lease, "signal 9 (Killed)"));
    EXPECT_EQ(find(job.id).status, JobStatus::Dismissed);
    EXPECT_FALSE(store_->claim(limits_, 60s));
}

TEST_P(JobQueueContract, KeepsALeaseThatIsRenewed) {
    submit();
    const Lease lease = claim_for_a_moment();
    EXPECT_TRUE(store_->renew(lease, 60s));
    EXPECT_FALSE(store_->claim(limits_, 60s));
    EXPECT_TRUE(store_->succeed(lease, {}));
}

TEST_P(JobQueueContract, TriesAJobAgainAfterOneCrashAndFailsItAfterTwo) {
    const JobDocument job = submit();
    EXPECT_TRUE(store_->crashed(claim(), "signal 9 (Killed)"));
    EXPECT_EQ(find(job.id).status, JobStatus::Accepted);
    EXPECT_TRUE(store_->crashed(claim(), "signal 9 (Killed)"));
    const JobDocument failed = find(job.id);
    EXPECT_EQ(failed.status, JobStatus::Failed);
    EXPECT_EQ(failed.problem->detail, "the job process died twice: signal 9 (Killed)");
    EXPECT_EQ(failed.problem->stage, "decode");
}

TEST_P(JobQueueContract, CountsNoCrashWhenAJobIsHandedBack) {
    const JobDocument job = submit();
    for (int i = 0; i < 5; ++i) EXPECT_TRUE(store_->release(claim()));
    EXPECT_EQ(find(job.id).status, JobStatus::Accepted);
    EXPECT_TRUE(store_->crashed(claim(), "signal 9 (Killed)"));
    EXPECT_EQ(find(job.id).status, JobStatus::Accepted);
}

TEST_P(JobQueueContract, TellsOfARepeatedLevelOnce) {
    const JobDocument job = submit();
    const Lease first = claim();
    store_->publish_level(first, level_with(0, kHash));
    store_->release(first);
    const Lease second = claim();
    EXPECT_TRUE(store_->publish_level(second, level_with(0, kHash)));
    EXPECT_EQ(std::ranges::count(events(job.id), "level"), 1);
    EXPECT_EQ(find(job.id).levels_ready, 1U);
}

TEST_P(JobQueueContract, QueuesRunningJobsAgainWhenItRecovers) {
    const JobDocument job = submit();
    const Lease lost = claim();
    reopen();
    EXPECT_FALSE(store_->claim(limits_, 60s));
    store_->recover();
    EXPECT_EQ(find(job.id).status, JobStatus::Accepted);
    EXPECT_EQ(claim().job_id, job.id);
    EXPECT_FALSE(store_->holds(lost));
}

TEST_P(JobQueueContract, FailsAJobThatTakesItsWorkersDownAgainAndAgain) {
    const JobDocument job = submit();
    for (int attempt = 1; attempt < 10; ++attempt) {
        EXPECT_EQ(claim().job_id, job.id);
        store_->recover();
    }
    EXPECT_EQ(find(job.id).status, JobStatus::Accepted);
    claim();
    store_->recover();
    const JobDocument failed = find(job.id);
    EXPECT_EQ(failed.status, JobStatus::Failed);
    EXPECT_EQ(failed.problem->detail,
              "its worker was lost in 10 attempts: it may need more memory than is available");
}

TEST_P(JobQueueContract, CountsNoLostWorkerWhenAJobIsHandedBack) {
    const JobDocument job = submit();
    for (int restart = 0; restart < 20; ++restart) EXPECT_TRUE(store_->release(claim()));
    claim();
    store_->recover();
    EXPECT_EQ(find(job.id).status, JobStatus::Accepted);
}

TEST_P(JobQueueContract, CountsHowJobsEnded) {
    EXPECT_EQ(store_->counts().ended.at("failed"), 0U);
    const JobDocument first = submit();
    store_->fail(claim(), kProblem);
    store_->dismiss("ada", first.id);  // removes it
    const JobDocument second = submit();
    store_->dismiss("ada", second.id);
    submit();
    store_->succeed(claim(), {});
    reopen();
    EXPECT_EQ(store_->counts().ended, (std::map<std::string, std::uint64_t>{
                                          {"dismissed", 1}, {"failed", 1}, {"successful", 1}}));
}

TEST_P(JobQueueContract, KeepsAJobForAsLongAsTimeCanBeCounted) {
    const JobDocument job = submit();
    store_->succeed(claim(), {});
    for (const auto retention : {std::chrono::seconds(9'999'999'999), std::chrono::seconds::max()})
        EXPECT_EQ(store_->remove_expired_jobs(retention) + store_->remove_expired_clouds(retention),
                  0U);
    EXPECT_EQ(find(job.id).status, JobStatus::Successful);
}

INSTANTIATE_TEST_SUITE_P(Stores, JobQueueContract, backends(),
                         [](const auto& instance) { return std::string(instance.param.name); });

}  // namespace
}  // namespace stipple::server
