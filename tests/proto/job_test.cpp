#include "stipple/proto/job.hpp"

#include "documents.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace stipple::proto {
namespace {

using test::golden;

TEST(JobStatus, NamesGoBothWays) {
    for (const JobStatus status : {JobStatus::Accepted, JobStatus::Running, JobStatus::Successful,
                                   JobStatus::Failed, JobStatus::Dismissed}) {
        EXPECT_EQ(job_status_from_name(to_string(status)), status);
    }
    EXPECT_THROW(job_status_from_name("done"), Error);
}

TEST(JobStatus, IsFinalWhenNothingMoreWillHappen) {
    EXPECT_FALSE(is_final(JobStatus::Accepted));
    EXPECT_FALSE(is_final(JobStatus::Running));
    EXPECT_TRUE(is_final(JobStatus::Successful));
    EXPECT_TRUE(is_final(JobStatus::Failed));
    EXPECT_TRUE(is_final(JobStatus::Dismissed));
}

TEST(JobDocument, TravelsAsTheGoldenFileSays) {
    const std::string text = to_json(test::failed_job());
    EXPECT_EQ(text, golden("failed_job.json"));
    EXPECT_EQ(to_json(job_document_from_json(text)), text);
}

TEST(JobDocument, WithoutTimesAndProblemTravelsToo) {
    JobDocument document = test::failed_job();
    document.status = JobStatus::Accepted;
    document.started = document.finished = "";
    document.problem.reset();
    const JobDocument back = job_document_from_json(to_json(document));
    EXPECT_EQ(back.started, "");
    EXPECT_FALSE(back.problem);
    EXPECT_EQ(to_json(back), to_json(document));
}

TEST(JobDocument, ThatIsMalformedIsRefusedByThePathOfTheField) {
    auto json = nlohmann::json::parse(to_json(test::failed_job()));
    json["request"]["draco"]["coding"] = "zip";
    EXPECT_EQ(test::refusal(job_document_from_json, json.dump(), ErrorCode::MalformedInput),
              "request.draco.coding: \"zip\": expected one of auto, sequential, kd-tree");
}

TEST(JobDocument, OfALaterVersionIsReadAsFarAsItIsKnown) {
    const std::string text = to_json(test::failed_job());
    auto json = nlohmann::json::parse(text);
    json["shard"] = 7;
    json["links"][0]["title"] = "self";
    json["request"]["draco"]["speed"] = 9;
    EXPECT_EQ(to_json(job_document_from_json(json.dump())), text);
}

TEST(CloudDocument, TravelsAsTheGoldenFileSays) {
    const std::string text = to_json(test::cloud_document());
    EXPECT_EQ(text, golden("cloud.json"));
    EXPECT_EQ(to_json(cloud_document_from_json(text)), text);
}

TEST(CloudDocument, WithoutNameAndStatisticsTravelsToo) {
    CloudDocument document = test::cloud_document();
    document.name.reset();
    document.statistics.reset();
    const CloudDocument back = cloud_document_from_json(to_json(document));
    EXPECT_FALSE(back.name);
    EXPECT_FALSE(back.statistics);
}

TEST(CloudStatistics, TravelWithoutBoundsWhenThereAreNoPoints) {
    CloudStatistics empty = test::statistics();
    empty.bounds = {};
    EXPECT_TRUE(cloud_statistics_from_json(to_json(empty)).bounds.empty());
    CloudStatistics full = cloud_statistics_from_json(to_json(test::statistics()));
    EXPECT_EQ(to_json(full), to_json(test::statistics()));
    EXPECT_FALSE(full.outliers);
    full.outliers = 0;
    EXPECT_EQ(cloud_statistics_from_json(to_json(full)).outliers, 0U);
}

TEST(CloudStatistics, DescribeWhatACloudHas) {
    const PointCloud cloud = test::with_attributes(test::sphere(100));
    const DecodeReport report{.format = CloudFormat::Ply,
                              .encoding = "ascii",
                              .points = 103,
                              .faces = 7,
                              .skipped = {"face.vertex_indices"},
                              .comments = std::vector<std::string>(5000, "spam")};
    const CloudStatistics statistics = describe(cloud, report, 1, 2);
    EXPECT_EQ(statistics.points, 103U);
    EXPECT_EQ(statistics.non_finite, 1U);
    EXPECT_EQ(statistics.duplicates, 2U);
    EXPECT_EQ(statistics.bounds.max, bounds(cloud).max);
    EXPECT_EQ(statistics.encoding, "ascii");
    EXPECT_EQ(statistics.comments.size(), 100U);  // a header cannot swell the documents
    ASSERT_EQ(statistics.attributes.size(), 4U);
    EXPECT_EQ(statistics.attributes[0].name, "normal");
    EXPECT_EQ(statistics.attributes[1].components, 3U);
    EXPECT_EQ(statistics.attributes[2].type, "float32");
    EXPECT_EQ(statistics.attributes[3].type, "int32");
}

TEST(Page, ListsItemsAndTheCursorWhenThereIsMore) {
    EXPECT_EQ(page_json({}, {}), R"({"items":[]})");
    EXPECT_EQ(page_json({R"({"a":1})", R"({"b":2})"}, "x\"y"),
              R"({"items":[{"a":1},{"b":2}],"next":"x\"y"})");
}

}  // namespace
}  // namespace stipple::proto
