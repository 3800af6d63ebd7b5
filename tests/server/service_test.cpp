#include "service/service.hpp"

#include "store_fixtures.hpp"

#include "service/housekeeper.hpp"
#include "store/sqlite.hpp"

#include <algorithm>
#include <thread>

namespace stipple::server {
namespace {

using namespace stipple::test;
using namespace std::chrono_literals;
using proto::JobDocument;
using proto::JobStatus;
using std::chrono::steady_clock;

const std::string& kPly = kOnePoint;
const std::string kMissing(64, '0');

class ServiceTest : public testing::Test {
protected:
    proto::CloudDocument upload(std::string_view bytes, const std::string& tenant = "ada",
                                const std::optional<std::string>& name = {}) {
        const auto writer = service_.begin_upload();
        writer->write(bytes_of(bytes));
        auto [cloud, existed] = service_.finish_upload(tenant, *writer, bytes_of(bytes), name);
        existed_ = existed;
        return cloud;
    }
    JobDocument submit_simplify() {
        return service_.submit("ada", simplify_request(upload(kPly).id), {}).document;
    }
    JobDocument submit_pyramid() {
        return service_.submit("ada", pyramid_request(upload(kPly).id), {}).document;
    }
    Lease claim() { return jobs_->claim({}, 60s).value(); }

    TemporaryFolder folder_;
    Limits limits_{.max_upload_bytes = 1000, .decode = {}, .queue = {}, .max_wait = 2s};
    std::unique_ptr<BlobStore> blobs_ = open_file_blob_store(folder_ / "blobs");
    std::unique_ptr<JobStore> jobs_ = open_sqlite_job_store(folder_ / "jobs.sqlite");
    Service service_{limits_, *jobs_, *blobs_};
    bool existed_ = false;
};

TEST_F(ServiceTest, KeepsAnUploadUnderTheHashOfItsBytes) {
    const proto::CloudDocument cloud = upload(kPly);
    EXPECT_FALSE(existed_);
    EXPECT_EQ(cloud.id, proto::sha256_hex(bytes_of(kPly)));
    EXPECT_EQ(cloud.format, CloudFormat::Ply);
    EXPECT_EQ(cloud.bytes, kPly.size());
    EXPECT_EQ(cloud.links.at(1).href, "/v1/clouds/" + cloud.id + "/content");
    EXPECT_EQ(text_of(*service_.cloud_content("ada", cloud.id)), kPly);
    upload(kPly);
    EXPECT_TRUE(existed_);
}

TEST_F(ServiceTest, TellsTheNameOfACloudAndOfTheInputOfAJob) {
    EXPECT_EQ(upload(kPly, "ada", "scan.ply").name, "scan.ply");
    EXPECT_EQ(submit_simplify().input_name, "scan.ply") << "the upload without a name took it away";
    EXPECT_EQ(upload(kPly, "bob").name, std::nullopt);
    service_.remove_cloud("bob", upload(kPly, "bob", "another.ply").id);
    EXPECT_EQ(submit_pyramid().input_name, "scan.ply");
}

TEST_F(ServiceTest, RefusesBytesThatAreNoCloud) {
    expect_error(ErrorCode::UnsupportedFormat, "neither PLY, Draco nor a progressive stream",
                 [&] { upload("PK\x03\x04"); });
    expect_error(ErrorCode::UnsupportedFormat, "empty", [&] { upload(""); });
    expect_error(ErrorCode::MalformedInput, "the file is cut short",
                 [&] { upload(kPly.substr(0, kPly.size() - 3)); });
    EXPECT_TRUE(service_.clouds("ada", 10, {}).items.empty());
}

TEST_F(ServiceTest, RefusesAnUploadAboveTheLimit) {
    expect_error(ErrorCode::TooLarge, "more than 1000 bytes",
                 [&] { upload(std::string(1001, 'x')); });
}

TEST_F(ServiceTest, KnowsNothingOfWhatIsMissingOrAnothers) {
    const std::string cloud = upload(kPly).id;
    const std::string job = submit_simplify().id;
    const auto expect_missing = [](auto call) {
        expect_error(ErrorCode::NotFound, "no such", call);
    };
    expect_missing([&] { service_.cloud("bob", cloud); });
    expect_missing([&] { service_.cloud_content("bob", cloud); });
    expect_missing([&] { service_.remove_cloud("bob", cloud); });
    expect_missing([&] { service_.submit("bob", simplify_request(cloud), {}); });
    expect_missing([&] { service_.job("bob", job); });
    expect_missing([&] { service_.wait_for_job("bob", job, 1s, {}); });
    expect_missing([&] { service_.events("bob", job, 0, 1s, {}); });
    expect_missing([&] { service_.results("bob", job); });
    expect_missing([&] { service_.outputs().file("bob", job, cloud, {}); });
    expect_missing([&] { service_.dismiss("bob", job); });
    expect_missing([&] { service_.cloud("ada", kMissing); });
    expect_missing([&] { service_.job("ada", "../jobs"); });
}

TEST_F(ServiceTest, RefusesPagesAndKeysOutOfRange) {
    const auto request = simplify_request(upload(kPly).id);
    const auto invalid = [](std::string_view part, auto call) {
        expect_error(ErrorCode::InvalidArgument, part, call);
    };
    invalid("limit 0", [&] { service_.jobs("ada", {}, 0, {}); });
    invalid("limit 1001", [&] { service_.clouds("ada", 1001, {}); });
    invalid("idempotency key", [&] { service_.submit("ada", request, ""); });
    invalid("idempotency key", [&] { service_.submit("ada", request, "a\nb"); });
    invalid("256 bytes", [&] { service_.submit("ada", request, std::string(256, 'k')); });
    invalid("points", [&] { service_.submit("ada", simplify_request(request.input, 0), {}); });
}

TEST_F(ServiceTest, RefusesAtOnceACloudThatIsKnownToHaveNoPoint) {
    const std::string cloud = submit_simplify().request.input;
    proto::CloudStatistics statistics = statistics_of(5);
    statistics.non_finite = 5;
    EXPECT_TRUE(jobs_->report_source(claim(), statistics));
    expect_error(ErrorCode::MalformedInput, "no point with finite coordinates: expected at least 1",
                 [&] { service_.submit("ada", simplify_request(cloud), {}); });
}

TEST_F(ServiceTest, TellsWhoRepeatsARequestOfItsJobWhateverIsKnownSince) {
    const auto request = simplify_request(upload(kPly).id);
    const JobDocument job = service_.submit("ada", request, "key").document;
    proto::CloudStatistics statistics = statistics_of(5);
    statistics.non_finite = 5;
    EXPECT_TRUE(jobs_->report_source(claim(), statistics));
    const auto again = service_.submit("ada", request, "key");
    EXPECT_TRUE(again.existed);
    EXPECT_EQ(again.document.id, job.id);
    EXPECT_EQ(again.document.links.size(), job.links.size());
    expect_error(ErrorCode::Conflict, "was used for another request",
                 [&] { service_.submit("ada", simplify_request(request.input, 7), "key"); });
    expect_error(ErrorCode::MalformedInput, "no point with finite coordinates",
                 [&] { service_.submit("ada", request, "another key"); });
}

TEST_F(ServiceTest, ShowsProgressAfterTheClockWasSetBack) {
    const JobDocument job = submit_simplify();
    const Lease lease = claim();
    sqlite::Connection(folder_ / "jobs.sqlite")
        .run("UPDATE jobs SET told = told + ?1", std::int64_t{4'000'000'000'000});
    EXPECT_TRUE(jobs_->report_progress(lease, "simplify", 40));
    EXPECT_EQ(service_.job("ada", job.id).progress, 40);
}

TEST_F(ServiceTest, LinksAJobToWhatBelongsToIt) {
    const auto href = [](const JobDocument& job, const std::string& rel) {
        const auto link = std::ranges::find(job.links, rel, &proto::Link::rel);
        return link == job.links.end() ? "" : link->href;
    };
    const JobDocument simplify = submit_simplify();
    EXPECT_EQ(href(simplify, "self"), "/v1/jobs/" + simplify.id);
    EXPECT_EQ(href(simplify, "events"), "/v1/jobs/" + simplify.id + "/events");
    EXPECT_EQ(href(simplify, "results"), "/v1/jobs/" + simplify.id + "/results");
    EXPECT_EQ(href(simplify, "pyramid"), "");
    const JobDocument pyramid = submit_pyramid();
    EXPECT_EQ(href(pyramid, "pyramid"), "/v1/pyramids/" + pyramid.id + "/manifest.json");
    EXPECT_EQ(href(pyramid, "viewer"), "/?pyramid=" + pyramid.id);
    EXPECT_EQ(href(pyramid, "tileset"), "/v1/pyramids/" + pyramid.id + "/tileset.json");
    proto::JobRequest whole = pyramid_request(upload(kPly).id);
    std::get<proto::PyramidJob>(whole.job).output.formats = {CloudFormat::Draco};
    EXPECT_EQ(href(service_.submit("ada", whole, {}).document, "tileset"), "") << "has no tiles";
}

TEST_F(ServiceTest, ServesResultsWhileTheJobRuns) {
    const JobDocument job = submit_pyramid();
    const Lease lease = claim();
    const std::string file = put_blob(*blobs_, "level");
    jobs_->publish_level(lease, level_with(0, file));
    const auto results = service_.results("ada", job.id);
    EXPECT_FALSE(results->complete);
    EXPECT_EQ(results->levels.at(0).files.at(0).href,
              "/v1/pyramids/" + job.id + "/" + file + ".ply");
    EXPECT_EQ(service_.outputs().file("ada", job.id, file + ".ply", {}).size(), 5U);
    jobs_->succeed(lease, {});
    EXPECT_TRUE(service_.results("ada", job.id)->complete);
}

TEST_F(ServiceTest, ServesNoBlobThatTheJobDoesNotList) {
    const JobDocument job = submit_simplify();
    jobs_->publish_level(claim(), level_with(0, put_blob(*blobs_, "level")));
    expect_error(ErrorCode::NotFound, "no such result", [&] {
        service_.outputs().file("ada", job.id, put_blob(*blobs_, "of another") + ".ply", {});
    });
}

TEST_F(ServiceTest, AnswersALongPollAsSoonAsTheJobEnds) {
    const JobDocument job = submit_simplify();
    const Lease lease = claim();
    std::jthread worker([&] {
        std::this_thread::sleep_for(50ms);
        jobs_->succeed(lease, {});
    });
    const auto start = steady_clock::now();
    EXPECT_EQ(service_.wait_for_job("ada", job.id, 60s, {}).status, JobStatus::Successful);
    EXPECT_LT(steady_clock::now() - start, 1500ms) << "the limit of a wait is 2 s here";
}

TEST_F(ServiceTest, EndsALongPollAtItsLimitAndWhenAskedToStop) {
    const JobDocument job = submit_simplify();
    EXPECT_EQ(service_.wait_for_job("ada", job.id, 20ms, {}).status, JobStatus::Accepted);
    const auto start = steady_clock::now();
    service_.wait_for_job("ada", job.id, 1h, {});
    EXPECT_GE(steady_clock::now() - start, limits_.max_wait);
    std::stop_source stopped;
    stopped.request_stop();
    service_.wait_for_job("ada", job.id, 1h, stopped.get_token());
    EXPECT_LT(steady_clock::now() - start, 30s);
}

TEST_F(ServiceTest, TellsEventsAsTheyHappenWithLinksToTheFiles) {
    const JobDocument job = submit_simplify();
    const Lease lease = claim();
    EXPECT_EQ(service_.events("ada", job.id, 0, 0ms, {}).items.size(), 2U);
    std::jthread worker([&] {
        std::this_thread::sleep_for(30ms);
        jobs_->publish_level(lease, level_with(0, kMissing));
    });
    const auto events = service_.events("ada", job.id, 2, 60s, {}).items;
    ASSERT_EQ(events.size(), 1U);
    EXPECT_EQ(events[0].type, "level");
    EXPECT_EQ(
        std::get<proto::OutputCloud>(proto::job_report_from_json(events[0].data)).files.at(0).href,
        "/v1/jobs/" + job.id + "/results/" + kMissing + ".ply");
    worker.join();
    jobs_->succeed(lease, {});
    EXPECT_EQ(service_.events("ada", job.id, 3, 60s, {}).items.size(), 1U);
    const auto start = steady_clock::now();
    const auto none = service_.events("ada", job.id, 4, 60s, {});
    EXPECT_TRUE(none.items.empty());
    EXPECT_TRUE(none.complete) << "nothing more will come";
    EXPECT_LT(steady_clock::now() - start, 1s);
}

TEST_F(ServiceTest, TellsLargeEventsOneByOneAndEachAlike) {
    const JobDocument job = submit_simplify();
    const Lease lease = claim();
    proto::OutputCloud level = level_with(0, kMissing);
    level.files.resize(10'000, level.files[0]);
    for (unsigned i = 0; i < 2; ++i) {
        level.level = i;
        jobs_->publish_level(lease, level);
    }
    std::uint64_t after = 2;
    for (unsigned i = 0; i < 2; ++i) {
        const auto first = service_.events("ada", job.id, after, 60s, {}).items;
        ASSERT_EQ(first.size(), 1U);
        const auto told =
            std::get<proto::OutputCloud>(proto::job_report_from_json(first[0].text()));
        EXPECT_EQ(told.level, i);
        EXPECT_EQ(told.files.back().href, "/v1/jobs/" + job.id + "/results/" + kMissing + ".ply");
        const auto again = service_.events("ada", job.id, after, 60s, {}).items;
        EXPECT_EQ(again[0].text(), first[0].text());
        EXPECT_EQ(again[0].shared, first[0].shared) << "the same bytes for all who follow";
        EXPECT_NE(first[0].shared, nullptr);
        EXPECT_TRUE(service_.has_events("ada", job.id, after));
        after = first[0].id;
    }
    EXPECT_FALSE(service_.has_events("ada", job.id, after));
}

TEST_F(ServiceTest, DismissesAndThenRemovesAJob) {
    const JobDocument job = submit_simplify();
    EXPECT_EQ(service_.dismiss("ada", job.id).status, JobStatus::Dismissed);
    EXPECT_EQ(service_.job("ada", job.id).status, JobStatus::Dismissed);
    EXPECT_EQ(service_.dismiss("ada", job.id).status, JobStatus::Dismissed);
    EXPECT_THROW(service_.job("ada", job.id), Error);
}

TEST_F(ServiceTest, IsReadyUnlessBlobsCannotBeWritten) {
    EXPECT_NO_THROW(service_.check_ready());
    std::filesystem::remove_all(folder_ / "blobs");
    EXPECT_THROW(service_.check_ready(), Error);
}

// Housekeeping.

class HousekeeperTest : public ServiceTest {
protected:
    HousekeeperOptions options(std::chrono::milliseconds grace) const {
        return {.retention = 1h, .cloud_retention = 1h, .period = 10ms, .grace = grace};
    }
    /// Whether the blob goes within a time in which the housekeeper sweeps often.
    bool goes(const std::string& blob, std::chrono::milliseconds time) {
        const auto deadline = steady_clock::now() + time;
        while (steady_clock::now() < deadline) {
            if (!blobs_->open(blob)) return true;
            std::this_thread::sleep_for(5ms);
        }
        return false;
    }
};

TEST_F(HousekeeperTest, RemovesABlobThatNoRowNames) {
    const std::string orphan = put_blob(*blobs_, "orphan");
    const std::string kept = upload(kPly).id;
    const Housekeeper housekeeper(options(0ms), *jobs_, *blobs_);
    EXPECT_TRUE(goes(orphan, 10s));
    EXPECT_FALSE(goes(kept, 100ms));
}

TEST_F(HousekeeperTest, LeavesABlobThatIsYoung) {
    const std::string orphan = put_blob(*blobs_, "its row comes in a moment");
    const Housekeeper housekeeper(options(1h), *jobs_, *blobs_);
    EXPECT_FALSE(goes(orphan, 200ms));
}

TEST_F(HousekeeperTest, LeavesTheInputAndTheResultsOfAJobUntilItIsRemoved) {
    const JobDocument job = submit_simplify();
    const std::string result = put_blob(*blobs_, "level");
    jobs_->publish_level(claim(), level_with(0, result));
    const Housekeeper housekeeper(options(0ms), *jobs_, *blobs_);
    EXPECT_FALSE(goes(job.request.input, 100ms));
    EXPECT_FALSE(goes(result, 50ms));
    service_.dismiss("ada", job.id);
    service_.dismiss("ada", job.id);
    EXPECT_TRUE(goes(result, 10s));
    EXPECT_FALSE(goes(job.request.input, 50ms)) << "the cloud is still listed";
}

TEST_F(HousekeeperTest, MakesRoomAlsoWhereNoRowCanBeRemoved) {
    const JobDocument job = submit_simplify();
    service_.dismiss("ada", job.id);
    sqlite::Connection(folder_ / "jobs.sqlite")
        .script("CREATE TRIGGER full BEFORE DELETE ON jobs BEGIN SELECT RAISE(ABORT, 'full'); END");
    const std::string orphan = put_blob(*blobs_, "orphan");
    std::this_thread::sleep_for(5ms);
    const Housekeeper housekeeper(
        {.retention = 0s, .cloud_retention = 0s, .period = 10ms, .grace = 0ms}, *jobs_, *blobs_);
    EXPECT_TRUE(goes(orphan, 10s));
    EXPECT_TRUE(goes(job.request.input, 10s)) << "clouds do not wait for jobs";
    EXPECT_TRUE(jobs_->find_job("ada", job.id));
}

TEST_F(HousekeeperTest, ExpiresNothingRightAfterTheStart) {
    const JobDocument job = submit_simplify();
    service_.dismiss("ada", job.id);
    sqlite::Connection(folder_ / "jobs.sqlite")
        .script("UPDATE jobs SET finished = 0; UPDATE clouds SET used = 0");
    for (const bool settled : {false, true}) {
        HousekeeperOptions sweeping = options(0ms);
        if (settled) sweeping.settling = 0ms;
        const std::string orphan = put_blob(*blobs_, "orphan");
        const Housekeeper housekeeper(sweeping, *jobs_, *blobs_);
        EXPECT_TRUE(goes(orphan, 10s)) << "it does not sweep";
        EXPECT_EQ(goes(job.request.input, settled ? 10s : 50ms), settled);
        EXPECT_EQ(jobs_->find_job("ada", job.id).has_value(), !settled);
    }
}

TEST_F(HousekeeperTest, RemovesJobsWhoseTimeIsOver) {
    const JobDocument job = submit_simplify();
    service_.dismiss("ada", job.id);
    std::this_thread::sleep_for(5ms);
    const Housekeeper housekeeper(
        {.retention = 0s, .cloud_retention = 1h, .period = 10ms, .grace = 1h}, *jobs_, *blobs_);
    const auto deadline = steady_clock::now() + 10s;
    while (jobs_->find_job("ada", job.id) && steady_clock::now() < deadline) {
        std::this_thread::sleep_for(5ms);
    }
    EXPECT_FALSE(jobs_->find_job("ada", job.id));
}

TEST_F(HousekeeperTest, RemovesCloudsWhoseTimeIsOverWithTheirBytes) {
    const std::string cloud = upload(kPly).id;
    std::this_thread::sleep_for(5ms);
    const Housekeeper housekeeper(
        {.retention = 1h, .cloud_retention = 0s, .period = 10ms, .grace = 0ms}, *jobs_, *blobs_);
    EXPECT_TRUE(goes(cloud, 10s));
    EXPECT_FALSE(jobs_->find_cloud("ada", cloud));
}

}  // namespace
}  // namespace stipple::server
