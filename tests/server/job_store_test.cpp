#include "job_store_contract.hpp"

#include "store/sqlite.hpp"
#include "store/store_fault.hpp"

#include <sqlite3.h>
#include <sys/fsuid.h>
#include <algorithm>
#include <set>

namespace stipple::server {
namespace {

using namespace stipple::test;
using namespace std::chrono_literals;
namespace fs = std::filesystem;
using proto::JobDocument;
using proto::JobStatus;

// Clouds.

TEST_P(JobStoreContract, TakesACloudOncePerTenant) {
    const CloudRow row{.tenant = "ada",
                       .id = kHash,
                       .name = {},
                       .format = CloudFormat::Draco,
                       .bytes = 42,
                       .created = {},
                       .statistics = {}};
    EXPECT_EQ(store_->put_cloud(row), Submitted::Created);
    EXPECT_EQ(store_->put_cloud(row), Submitted::Existing);
    const auto found = store_->find_cloud("ada", kHash);
    ASSERT_TRUE(found);
    EXPECT_EQ(found->format, CloudFormat::Draco);
    EXPECT_EQ(found->bytes, 42U);
    EXPECT_FALSE(found->statistics);
    EXPECT_FALSE(found->name);
}

TEST_P(JobStoreContract, KeepsTheNameThatACloudWasGivenLast) {
    CloudRow row{.tenant = "ada",
                 .id = kHash,
                 .name = "first",
                 .format = CloudFormat::Ply,
                 .bytes = 42,
                 .created = {},
                 .statistics = {}};
    store_->put_cloud(row);
    row.name = "second";
    EXPECT_EQ(store_->put_cloud(row), Submitted::Existing);
    row.name = {};
    store_->put_cloud(row);
    reopen();
    EXPECT_EQ(store_->find_cloud("ada", kHash)->name, "second");
}

TEST_P(JobStoreContract, TellsTimesInUtcWithMilliseconds) {
    const auto form = [](std::string time) {
        std::ranges::replace_if(
            time, [](char c) { return c >= '0' && c <= '9'; }, '0');
        return time;
    };
    const char* const expected = "0000-00-00T00:00:00.000Z";
    const std::string cloud = put_cloud(*store_, "ada", "cloud");
    EXPECT_EQ(form(store_->find_cloud("ada", cloud)->created), expected);
    const JobDocument job = submit();
    EXPECT_EQ(form(job.created), expected);
    EXPECT_EQ(job.started, "");
    EXPECT_EQ(job.finished, "");
}

TEST_P(JobStoreContract, KeepsTheStatisticsOfACloud) {
    const std::string cloud = submit().request.input;
    EXPECT_TRUE(store_->report_source(claim(), statistics_of(7)));
    reopen();
    EXPECT_EQ(store_->find_cloud("ada", cloud)->statistics->points, 7U);
}

TEST_P(JobStoreContract, KeepsTheOutliersThatAJobRemovedApartFromItsCloud) {
    const JobDocument job = submit();
    proto::CloudStatistics source = statistics_of(7);
    source.outliers = 2;
    EXPECT_TRUE(store_->report_source(claim(), source));
    EXPECT_FALSE(store_->find_cloud("ada", job.request.input)->statistics->outliers);
    EXPECT_EQ(store_->results("ada", job.id)->source->outliers, 2U);
}

TEST_P(JobStoreContract, KeepsACloudWhileAnUnfinishedJobNeedsIt) {
    const JobDocument job = submit();
    const std::string cloud = job.request.input;
    expect_error(ErrorCode::Conflict, job.id, [&] { store_->remove_cloud("ada", cloud); });
    store_->dismiss("ada", job.id);
    EXPECT_TRUE(store_->remove_cloud("ada", cloud));
    EXPECT_FALSE(store_->remove_cloud("ada", cloud));
}

// Jobs.

TEST_P(JobStoreContract, RefusesAJobWithoutItsCloud) {
    expect_error(ErrorCode::NotFound, "input " + kHash + ": no such cloud",
                 [&] { store_->submit("ada", simplify_request(kHash), {}, limits_); });
    put_cloud(*store_, "bob", "cloud");
    const std::string of_bob = proto::sha256_hex(bytes_of("cloud"));
    EXPECT_THROW(store_->submit("ada", simplify_request(of_bob), {}, limits_), Error);
    EXPECT_EQ(store_->counts().queued, 0U);
}

TEST_P(JobStoreContract, KeepsAJobAsItWasAcknowledged) {
    const JobDocument job = submit("ada", {}, 77);
    reopen();
    const JobDocument found = find(job.id);
    EXPECT_EQ(to_json(found), to_json(job));
    EXPECT_EQ(found.status, JobStatus::Accepted);
    EXPECT_EQ(found.stage, "queued");
}

TEST_P(JobStoreContract, AnswersARepeatedSubmissionWithTheSameJob) {
    const JobDocument first = submit("ada", "key");
    EXPECT_EQ(submit("ada", "key").id, first.id);
    EXPECT_EQ(store_->counts().queued, 1U);
    EXPECT_NE(submit("bob", "key").id, first.id) << "a key belongs to its tenant";
    EXPECT_NE(submit("ada", "other").id, first.id);
}

TEST_P(JobStoreContract, RefusesAnotherRequestUnderTheSameKey) {
    submit("ada", "key", 100);
    expect_error(ErrorCode::Conflict, "idempotency key \"key\"",
                 [&] { submit("ada", "key", 101); });
}

TEST_P(JobStoreContract, RefusesJobsBeyondTheQueueLimitOfTheirTenant) {
    limits_.max_queued = 2;
    submit("ada", "key");
    submit();
    expect_error(ErrorCode::QueueFull, "the limit is 2", [&] { submit(); });
    EXPECT_NO_THROW(submit("ada", "key")) << "a repeated submission adds nothing";
    EXPECT_NO_THROW(submit("bob"));
    claim();
    EXPECT_NO_THROW(submit());
}

TEST_P(JobStoreContract, ShowsATenantNothingOfAnother) {
    const JobDocument job = submit();
    const std::string cloud = job.request.input;
    EXPECT_FALSE(store_->find_job("bob", job.id));
    EXPECT_FALSE(store_->find_cloud("bob", cloud));
    EXPECT_FALSE(store_->dismiss("bob", job.id));
    EXPECT_FALSE(store_->results("bob", job.id));
    EXPECT_FALSE(store_->remove_cloud("bob", cloud));
    EXPECT_TRUE(store_->events_after("bob", job.id, 0).empty());
    EXPECT_TRUE(store_->list_jobs("bob", {}, 10, {}).items.empty());
    EXPECT_TRUE(store_->list_clouds("bob", 10, {}).items.empty());
    EXPECT_EQ(find(job.id).status, JobStatus::Accepted);
}

TEST_P(JobStoreContract, PagesThroughJobsNewestFirstWhileMoreAreAdded) {
    std::vector<std::string> expected;
    for (int i = 0; i < 5; ++i) expected.insert(expected.begin(), submit().id);
    std::vector<std::string> seen;
    std::optional<std::string> cursor;
    do {
        const Page<JobDocument> page = store_->list_jobs("ada", {}, 2, cursor);
        for (const JobDocument& job : page.items) seen.push_back(job.id);
        cursor = page.next;
        submit();
    } while (cursor);
    EXPECT_EQ(seen, expected);
}

TEST_P(JobStoreContract, EndsAPageOfLongRequestsEarly) {
    const std::string cloud = put_cloud(*store_, "ada", "cloud");
    proto::SimplifyJob job;
    job.options.points = 10;
    job.options.reductions[std::string(60'000, 'w')] = Reduction::Mean;
    std::vector<std::string> expected;
    for (int i = 0; i < 40; ++i)
        expected.insert(expected.begin(),
                        store_->submit("ada", {cloud, job}, {}, limits_).document.id);
    std::vector<std::string> seen;
    std::optional<std::string> cursor;
    do {
        const Page<JobDocument> page = store_->list_jobs("ada", {}, 1000, cursor);
        EXPECT_LE(page.items.size(), 20U) << "more than a megabyte";
        for (const JobDocument& document : page.items) seen.push_back(document.id);
        cursor = page.next;
    } while (cursor);
    EXPECT_EQ(seen, expected);
}

TEST_P(JobStoreContract, PagesThroughClouds) {
    std::set<std::string> expected;
    for (const char* text : {"a", "b", "c"}) expected.insert(put_cloud(*store_, "ada", text));
    std::set<std::string> seen;
    const Page<CloudRow> first = store_->list_clouds("ada", 2, {});
    for (const CloudRow& row : first.items) seen.insert(row.id);
    ASSERT_TRUE(first.next);
    const Page<CloudRow> second = store_->list_clouds("ada", 2, first.next);
    for (const CloudRow& row : second.items) seen.insert(row.id);
    EXPECT_EQ(seen, expected);
    EXPECT_FALSE(second.next);
}

TEST_P(JobStoreContract, RefusesACursorThatItDidNotGive) {
    submit();
    submit();
    const auto next = store_->list_jobs("ada", {}, 1, {}).next;
    for (const std::string& cursor : {std::string(), std::string("1"), std::string("'; DROP TABLE"),
                                      *next + "A", std::string(10'000, 'x')}) {
        expect_error(ErrorCode::InvalidArgument, "cursor",
                     [&] { store_->list_jobs("ada", {}, 1, cursor); });
    }
    expect_error(ErrorCode::InvalidArgument, "of this listing",
                 [&] { store_->list_clouds("ada", 1, next); });
}

TEST_P(JobStoreContract, FiltersJobsByTypeStatusAndInput) {
    const JobDocument simplify = submit();
    const JobDocument pyramid =
        store_->submit("ada", pyramid_request(put_cloud(*store_, "ada", "other")), {}, limits_)
            .document;
    claim();
    const auto ids = [this](const JobStore::JobFilter& filter) {
        std::vector<std::string> found;
        const Page<JobDocument> page = store_->list_jobs("ada", filter, 10, {});
        for (const JobDocument& job : page.items) found.push_back(job.id);
        return found;
    };
    using Ids = std::vector<std::string>;
    EXPECT_EQ(ids({.type = "pyramid", .status = {}, .input = {}}), Ids{pyramid.id});
    EXPECT_EQ(ids({.type = {}, .status = "running", .input = {}}), Ids{simplify.id});
    EXPECT_EQ(ids({.type = {}, .status = {}, .input = pyramid.request.input}), Ids{pyramid.id});
    EXPECT_EQ(ids({.type = "pyramid", .status = "running", .input = {}}), Ids{});
}

TEST_P(JobStoreContract, CancelsNoJobThatHasEnded) {
    const JobDocument job = submit("ada", "key");
    EXPECT_FALSE(store_->cancel("bob", job.id));
    EXPECT_EQ(store_->cancel("ada", job.id)->status, JobStatus::Dismissed);
    expect_error(ErrorCode::Conflict, "has ended already: it is dismissed",
                 [&] { store_->cancel("ada", job.id); });
    const JobDocument other = submit("ada", "other");
    store_->succeed(claim(), {});
    expect_error(ErrorCode::Conflict, "has ended already: it is successful",
                 [&] { store_->cancel("ada", other.id); });
    EXPECT_TRUE(store_->find_job("ada", other.id));
}

TEST_P(JobStoreContract, RemovesAFinishedJobThatIsDismissed) {
    const JobDocument job = submit("ada", "key");
    store_->succeed(claim(), {});
    EXPECT_EQ(store_->dismiss("ada", job.id)->status, JobStatus::Successful);
    EXPECT_FALSE(store_->find_job("ada", job.id));
    EXPECT_TRUE(store_->events_after("ada", job.id, 0).empty());
    EXPECT_NE(submit("ada", "key").id, job.id);
}

// Housekeeping.

TEST_P(JobStoreContract, CountsWhatWaitsAndWhatRuns) {
    submit();
    submit();
    claim();
    std::this_thread::sleep_for(10ms);
    const JobStore::Counts counts = store_->counts();
    EXPECT_EQ(counts.queued, 1U);
    EXPECT_EQ(counts.running, 1U);
    EXPECT_GT(counts.oldest_queued_seconds, 0.005);
    EXPECT_LT(counts.oldest_queued_seconds, 60);
}

TEST_P(JobStoreContract, RemovesWhatEndedLongAgoAndNothingElse) {
    const JobDocument finished = submit();
    store_->succeed(claim(), {});
    const JobDocument running = submit();
    claim();
    const JobDocument waiting = submit();
    EXPECT_EQ(store_->remove_expired_jobs(1h), 0U);
    EXPECT_TRUE(store_->find_job("ada", finished.id));
    std::this_thread::sleep_for(5ms);
    EXPECT_EQ(store_->remove_expired_jobs(0s), 1U);
    EXPECT_FALSE(store_->find_job("ada", finished.id));
    EXPECT_TRUE(store_->find_job("ada", running.id));
    EXPECT_TRUE(store_->find_job("ada", waiting.id));
}

TEST_P(JobStoreContract, RemovesCloudsThatNobodyHasUsedForLong) {
    const std::string unused = put_cloud(*store_, "ada", "unused"),
                      uploaded = put_cloud(*store_, "ada", "uploaded again"),
                      named = put_cloud(*store_, "ada", "named by a job");
    EXPECT_EQ(store_->remove_expired_clouds(1h), 0U);
    constexpr auto kLong = 2s;
    std::this_thread::sleep_for(kLong + 500ms);
    put_cloud(*store_, "ada", "uploaded again");
    store_->submit("ada", simplify_request(named), {}, {});
    EXPECT_EQ(store_->remove_expired_clouds(kLong), 1U);
    EXPECT_FALSE(store_->find_cloud("ada", unused));
    EXPECT_TRUE(store_->find_cloud("ada", uploaded));
    EXPECT_TRUE(store_->find_cloud("ada", named));
}

TEST_P(JobStoreContract, KeepsCloudsThatAnUnfinishedJobNeeds) {
    const JobDocument job = submit();
    const std::string candidate = put_cloud(*store_, "ada", "candidate");
    proto::EvaluateJob to_candidate;
    to_candidate.candidates = {candidate};
    const JobDocument evaluation =
        store_->submit("ada", {job.request.input, to_candidate}, {}, {}).document;
    std::this_thread::sleep_for(5ms);
    EXPECT_EQ(store_->remove_expired_clouds(0s), 0U);
    store_->succeed(claim(), {});
    store_->dismiss("ada", evaluation.id);
    EXPECT_EQ(store_->remove_expired_clouds(0s), 2U);
    EXPECT_TRUE(store_->find_job("ada", job.id)) << "results stay";
}

TEST_P(JobStoreContract, NamesEveryBlobThatARowNeeds) {
    const JobDocument job = submit();
    const Lease lease = claim();
    store_->publish_level(lease, level_with(0, kHash));
    auto blobs = store_->referenced_blobs();
    EXPECT_EQ(std::set(blobs.begin(), blobs.end()), (std::set{kHash, job.request.input}));
    store_->succeed(lease, {});
    store_->dismiss("ada", job.id);
    EXPECT_EQ(store_->referenced_blobs(), std::vector{job.request.input});
    store_->remove_cloud("ada", job.request.input);
    EXPECT_TRUE(store_->referenced_blobs().empty());
}

TEST_P(JobStoreContract, WakesWhoWaitsWhenSomethingIsWritten) {
    const std::uint64_t seen = store_->version();
    std::jthread writer([this] {
        std::this_thread::sleep_for(30ms);
        submit();
    });
    const auto start = std::chrono::steady_clock::now();
    store_->wait_for_change(seen, start + 60s, {});
    EXPECT_NE(store_->version(), seen);
    EXPECT_LT(std::chrono::steady_clock::now() - start, 30s);
}

TEST_P(JobStoreContract, EndsAWaitAtItsDeadlineAndWhenAskedToStop) {
    const std::uint64_t seen = store_->version();
    store_->wait_for_change(seen, std::chrono::steady_clock::now() + 10ms, {});
    std::stop_source stop;
    std::jthread stopper([&] {
        std::this_thread::sleep_for(20ms);
        stop.request_stop();
    });
    const auto start = std::chrono::steady_clock::now();
    store_->wait_for_change(seen, start + 60s, stop.get_token());
    EXPECT_LT(std::chrono::steady_clock::now() - start, 30s);
}

TEST_P(JobStoreContract, HasTheSameVersionWhileNothingChanges) {
    submit();
    const Lease lease = claim();
    const std::uint64_t seen = store_->version();
    store_->claim(limits_, 60s);
    store_->holds(lease);
    store_->succeed({lease.job_id, lease.tenant, lease.token + 1, lease.request}, {});
    store_->counts();
    store_->probe();
    EXPECT_EQ(store_->version(), seen);
}

INSTANTIATE_TEST_SUITE_P(Stores, JobStoreContract, backends(),
                         [](const auto& instance) { return std::string(instance.param.name); });

// SQLite alone.

TEST(SqliteJobStore, TellsWhatAnotherProcessWrote) {
    const TemporaryFolder folder;
    const auto open = [&] {
        return open_sqlite_job_store(folder / "jobs.sqlite", Sharing::WithOtherProcesses);
    };
    const auto api = open();
    const auto worker = open();
    const std::string cloud = put_cloud(*api, "ada", "cloud");
    std::this_thread::sleep_for(100ms);  // both have seen what was there
    const std::uint64_t seen = worker->version();
    const JobDocument job = api->submit("ada", simplify_request(cloud), {}, {}).document;
    worker->wait_for_change(seen, std::chrono::steady_clock::now() + 60s, {});
    EXPECT_NE(worker->version(), seen);

    const Lease lease = worker->claim({}, 60s).value();
    EXPECT_EQ(lease.job_id, job.id);
    EXPECT_EQ(api->find_job("ada", job.id)->status, JobStatus::Running);
    api->dismiss("ada", job.id);
    EXPECT_FALSE(worker->holds(lease));
}

void run_sql(const std::filesystem::path& file, const char* sql) {
    sqlite3* connection = nullptr;
    ASSERT_EQ(sqlite3_open(file.c_str(), &connection), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(connection, sql, nullptr, nullptr, nullptr), SQLITE_OK);
    sqlite3_close(connection);
}

TEST(SqliteJobStore, SaysThatAnotherProcessHoldsIt) {
    const TemporaryFolder folder;
    const auto store = open_sqlite_job_store(folder / "jobs.sqlite");
    sqlite3* other = nullptr;
    ASSERT_EQ(sqlite3_open((folder / "jobs.sqlite").c_str(), &other), SQLITE_OK);
    ASSERT_EQ(sqlite3_exec(other, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr), SQLITE_OK);
    EXPECT_THROW(put_cloud(*store, "ada", "cloud"), StoreFault);
    sqlite3_close(other);
    EXPECT_NO_THROW(put_cloud(*store, "ada", "cloud"));
}

TEST(SqliteJobStore, KeepsACloudThatIsAskedFor) {
    const TemporaryFolder folder;
    const auto store = open_sqlite_job_store(folder / "jobs.sqlite");
    const std::string asked_for = put_cloud(*store, "ada", "asked for");
    put_cloud(*store, "ada", "forgotten");
    run_sql(folder / "jobs.sqlite", "UPDATE clouds SET used = used - 7200000");
    EXPECT_TRUE(store->find_cloud("ada", asked_for));
    EXPECT_EQ(store->remove_expired_clouds(1h), 1U);
    EXPECT_TRUE(store->find_cloud("ada", asked_for));
}

TEST(SqliteJobStore, TakesOnlyCloudsOfResultsForInputs) {
    const TemporaryFolder folder;
    const auto store = open_sqlite_job_store(folder / "jobs.sqlite");
    store->submit("ada", pyramid_request(put_cloud(*store, "ada", "cloud")), {}, {});
    const Lease lease = store->claim({}, 60s).value();
    proto::OutputCloud level = level_with(0, std::string(64, 'a'));
    const auto add = [&](CloudFormat format, char digit) {
        level.files.push_back({format, 100, std::string(64, digit), ""});
    };
    add(CloudFormat::Draco, 'b');
    add(CloudFormat::Copc, 'c');
    store->publish_level(lease, level);
    const auto submit = [&](char digit) {
        store->submit("ada", simplify_request(std::string(64, digit)), {}, {});
    };
    EXPECT_NO_THROW(submit('a'));
    EXPECT_NO_THROW(submit('b'));
    expect_error(ErrorCode::UnsupportedFormat, "a copc.laz file that a job made",
                 [&] { submit('c'); });
    expect_error(ErrorCode::NotFound, "no such cloud", [&] { submit('d'); });
}

TEST(SqliteJobStore, BringsADatabaseOfAnOlderVersionUpToDate) {
    const TemporaryFolder folder;
    const std::string cloud = put_cloud(*open_sqlite_job_store(folder / "jobs.sqlite"), "ada", "a");
    run_sql(folder / "jobs.sqlite",  // as it was then
            "DROP INDEX clouds_by_use; ALTER TABLE clouds DROP COLUMN used; "
            "ALTER TABLE clouds DROP COLUMN name; ALTER TABLE jobs DROP COLUMN lost; "
            "DROP TABLE ended; DROP TABLE turns; DROP INDEX jobs_unfinished; "
            "PRAGMA application_id = 0; PRAGMA user_version = 1");
    const auto store = open_sqlite_job_store(folder / "jobs.sqlite");
    EXPECT_EQ(store->find_cloud("ada", cloud)->name, std::nullopt);
    EXPECT_EQ(store->remove_expired_clouds(1h), 0U) << "its time begins now";
    EXPECT_EQ(put_cloud(*store, "ada", "another").size(), 64U);
}

TEST(SqliteJobStore, CountsOnInADatabaseThatCountedNothing) {
    const TemporaryFolder folder;
    const auto request = [](JobStore& store) {
        return simplify_request(put_cloud(store, "ada", "cloud"));
    };
    JobDocument job;
    {
        const auto store = open_sqlite_job_store(folder / "jobs.sqlite");
        job = store->submit("ada", request(*store), {}, {}).document;
    }
    run_sql(folder / "jobs.sqlite",  // as it was then
            "DROP INDEX clouds_by_use; ALTER TABLE clouds DROP COLUMN used; "
            "ALTER TABLE jobs DROP COLUMN lost; DROP TABLE ended; DROP TABLE turns; "
            "DROP INDEX jobs_unfinished; PRAGMA application_id = 0; PRAGMA user_version = 2");
    const auto store = open_sqlite_job_store(folder / "jobs.sqlite");
    store->claim({}, 60s);
    store->recover();
    EXPECT_EQ(store->find_job("ada", job.id)->status, JobStatus::Accepted);
    store->succeed(store->claim({}, 60s).value(), {});
    EXPECT_EQ(store->counts().ended.at("successful"), 1U);
}

TEST(SqliteJobStore, MakesANewDatabaseOnceForAllWhoOpenItAtATime) {
    for (int round = 0; round < 20; ++round) {
        const TemporaryFolder folder;
        std::vector<std::jthread> threads;
        for (int i = 0; i < 4; ++i) {
            threads.emplace_back(
                [&] { EXPECT_NO_THROW(open_sqlite_job_store(folder / "jobs.sqlite")); });
        }
    }
}

TEST(SqliteJobStore, RefusesADatabaseOfAnotherProgramAndLeavesItAsItIs) {
    for (const char* made : {"CREATE TABLE notes (text)", "PRAGMA application_id = 7",
                             "CREATE TABLE clouds (kind); PRAGMA user_version = 2"}) {
        const TemporaryFolder folder;
        run_sql(folder / "jobs.sqlite", made);
        const std::string before = proto::sha256_of_file(folder / "jobs.sqlite");
        expect_error(ErrorCode::InvalidArgument, "database of another program",
                     [&] { open_sqlite_job_store(folder / "jobs.sqlite"); });
        EXPECT_EQ(proto::sha256_of_file(folder / "jobs.sqlite"), before);
    }
}

TEST(SqliteJobStore, NamesTheBlobsOfAStoreWithoutChangingIt) {
    const TemporaryFolder folder;
    const std::string cloud = put_cloud(*open_sqlite_job_store(folder / "j#1.sqlite"), "ada", "a");
    EXPECT_EQ(read_referenced_blobs(folder / "j#1.sqlite"), std::vector{cloud});
    const fs::directory_iterator files(folder.path());
    EXPECT_EQ(std::distance(begin(files), fs::directory_iterator()), 1) << "a file was made";
    EXPECT_THROW(read_referenced_blobs(folder / "missing.sqlite"), Error);
    EXPECT_FALSE(fs::exists(folder / "missing.sqlite"));
}

TEST(SqliteJobStore, NamesTheBlobsOfAStoreThatWasKilled) {
    const TemporaryFolder folder;
    const auto killed = open_sqlite_job_store(folder / "jobs.sqlite");
    const std::string cloud = put_cloud(*killed, "ada", "a");  // in the log alone
    EXPECT_EQ(read_referenced_blobs(folder / "jobs.sqlite"), std::vector{cloud});
}

TEST(SqliteJobStore, RefusesADatabaseOfANewerVersion) {
    const TemporaryFolder folder;
    open_sqlite_job_store(folder / "jobs.sqlite");
    run_sql(folder / "jobs.sqlite", "PRAGMA user_version = 999");
    expect_error(ErrorCode::InvalidArgument, "schema 999",
                 [&] { open_sqlite_job_store(folder / "jobs.sqlite"); });
}

/// Permissions are those of everybody, also where tests are run as root.
class AsNobody {
public:
    AsNobody() : before_(::setfsuid(kNobody)) {}
    ~AsNobody() { ::setfsuid(static_cast<uid_t>(before_)); }
    AsNobody(const AsNobody&) = delete;
    AsNobody& operator=(const AsNobody&) = delete;

private:
    static constexpr uid_t kNobody = 65534;
    const int before_;
};

TEST(SqliteJobStore, RefusesADatabaseThatItMayNotWrite) {
    const TemporaryFolder folder;
    const fs::path file = folder / "jobs.sqlite";
    open_sqlite_job_store(file);
    fs::permissions(folder.path(), fs::perms::all);
    fs::permissions(file, fs::perms::owner_read | fs::perms::group_read | fs::perms::others_read);
    const AsNobody nobody;
    expect_error(ErrorCode::Internal, "jobs.sqlite: it may only be read",
                 [&] { open_sqlite_job_store(file); });
}

TEST(SqliteJobStore, TellsThatItMayOnlyBeReadAsAFaultOfTheSystem) {
    const TemporaryFolder folder;
    open_sqlite_job_store(folder / "jobs.sqlite");
    sqlite::Connection reader(folder / "jobs.sqlite", sqlite::Access::Read);
    EXPECT_THROW(reader.run("DELETE FROM jobs"), StoreFault);
}

TEST(SqliteJobStore, RemovesExpiredJobsAsFarAsItCan) {
    const TemporaryFolder folder;
    const auto store = open_sqlite_job_store(folder / "jobs.sqlite");
    store->submit("ada", simplify_request(put_cloud(*store, "ada", "cloud")), {}, {});
    store->succeed(store->claim({}, 60s).value(), {});
    run_sql(folder / "jobs.sqlite",
            "WITH RECURSIVE numbers (n) AS (VALUES (1) UNION ALL SELECT n + 1 FROM numbers "
            "WHERE n < 999) "
            "INSERT INTO jobs (id, tenant, type, input, request, status, message, created, "
            "finished, updated) SELECT id || n, tenant, type, input, request, status, message, "
            "created, finished, updated FROM jobs, numbers; UPDATE jobs SET finished = row; "
            "CREATE TRIGGER full BEFORE DELETE ON jobs WHEN OLD.finished = 900 "
            "BEGIN SELECT RAISE(ABORT, 'full'); END");
    const auto left = [&] { return store->list_jobs("ada", {}, 1000, {}).items.size(); };
    ASSERT_EQ(left(), 1000U);
    EXPECT_THROW(store->remove_expired_jobs(1h), Error);
    EXPECT_LE(left(), 500U) << "what was removed before is gone";
    run_sql(folder / "jobs.sqlite", "DROP TRIGGER full");
    const std::size_t more = left();
    EXPECT_EQ(store->remove_expired_jobs(1h), more);
    EXPECT_EQ(left(), 0U);
}

TEST(SqliteJobStore, NamesTheBlobsOfADamagedStoreAsFarAsItCan) {
    const TemporaryFolder folder;
    const std::string cloud = put_cloud(*open_sqlite_job_store(folder / "jobs.sqlite"), "ada", "a");
    sqlite::Connection(folder / "jobs.sqlite").script("DROP TABLE outputs");  // as if unreadable
    std::vector<std::string> damage;
    EXPECT_EQ(read_referenced_blobs(folder / "jobs.sqlite", damage), std::vector{cloud});
    ASSERT_EQ(damage.size(), 1U);
    EXPECT_NE(damage[0].find("the names of files: "), std::string::npos) << damage[0];
}

TEST(SqliteJobStore, RefusesAFileThatIsNoDatabase) {
    const TemporaryFolder folder;
    std::filesystem::copy_file(std::filesystem::path("/proc/self/exe"), folder / "jobs.sqlite");
    for (const char* part : {"not a database", "/jobs.sqlite: "}) {
        expect_error(ErrorCode::Internal, part,
                     [&] { open_sqlite_job_store(folder / "jobs.sqlite"); });
    }
}

TEST(SqliteJobStore, FailsAJobWhoseRequestItCannotReadAndGoesOnToTheNext) {
    const TemporaryFolder folder;
    JobDocument next;
    {
        const auto store = open_sqlite_job_store(folder / "jobs.sqlite");
        const auto request = simplify_request(put_cloud(*store, "ada", "cloud"));
        store->submit("ada", request, {}, {});
        next = store->submit("ada", request, {}, {}).document;
    }
    run_sql(folder / "jobs.sqlite",
            R"(UPDATE jobs SET request = '{"type": "sculpt"}' WHERE row = 1)");
    const auto store = open_sqlite_job_store(folder / "jobs.sqlite");
    EXPECT_EQ(store->claim({}, 60s)->job_id, next.id);
    EXPECT_FALSE(store->claim({}, 60s));
}

TEST(SqliteJobStore, TellsOfJobsOfALaterVersionWhatItKnowsAndOfTheOthersAll) {
    const TemporaryFolder folder;
    std::vector<std::string> ids;
    {
        const auto store = open_sqlite_job_store(folder / "jobs.sqlite");
        const auto request = simplify_request(put_cloud(*store, "ada", "cloud"));
        for (int i = 0; i < 3; ++i)
            ids.push_back(store->submit("ada", request, {}, {}).document.id);
    }
    run_sql(folder / "jobs.sqlite",
            "UPDATE jobs SET request = json_set(request, '$.sharpness', 1) WHERE row = 1;"
            "UPDATE jobs SET request = json_set(request, '$.type', 'sculpt') WHERE row = 2");
    const auto store = open_sqlite_job_store(folder / "jobs.sqlite");
    const auto listed = store->list_jobs("ada", {}, 10, {}).items;
    ASSERT_EQ(listed.size(), 2U);
    EXPECT_EQ(listed[0].id, ids[2]);
    EXPECT_EQ(listed[1].id, ids[0]);
    EXPECT_TRUE(store->results("ada", ids[0]));
    expect_error(ErrorCode::Internal, "sculpt", [&] { store->find_job("ada", ids[1]); });
    EXPECT_EQ(store->dismiss("ada", ids[0])->status, JobStatus::Dismissed);
    EXPECT_EQ(store->dismiss("ada", ids[0])->id, ids[0]);
    EXPECT_FALSE(store->find_job("ada", ids[0]));
}

}  // namespace
}  // namespace stipple::server
