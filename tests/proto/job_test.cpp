#include "stipple/proto/job.hpp"

#include "documents.hpp"

#include <gtest/gtest.h>

namespace stipple::proto {
namespace {

using test::golden;
using test::kInput;

/// A simplify request with `fields` beside type and input.
std::string simplify_with(const std::string& fields) {
    return R"({"type": "simplify", "input": ")" + kInput + "\"" +
           (fields.empty() ? "" : ", " + fields) + "}";
}

std::string pyramid_with(const std::string& fields) {
    return R"({"type": "pyramid", "input": ")" + kInput + "\"" +
           (fields.empty() ? "" : ", " + fields) + "}";
}

std::string refusal(const std::string& json) {
    return test::refusal(job_request_from_json, json, ErrorCode::InvalidArgument);
}

TEST(JobRequest, TakesEveryFieldOfASimplifyJob) {
    const JobRequest request = job_request_from_json(simplify_with(
        R"("method": "hierarchical", "max_cluster_size": 50, "max_variation": 0.05,
           "representative": "surface", "seed": 18446744073709551615,
           "reductions": {"intensity": "max"}, "format": "drc",
           "draco": {"position_bits": 12, "normal_bits": 8, "attribute_bits": 9,
                     "compression_level": 10, "coding": "kd-tree"})"));
    EXPECT_EQ(request.input, kInput);
    EXPECT_EQ(type_name(request), "simplify");
    const auto& job = std::get<SimplifyJob>(request.job);
    EXPECT_EQ(job.options.hierarchical.max_cluster_size, 50U);
    EXPECT_EQ(job.options.hierarchical.max_variation, 0.05);
    EXPECT_EQ(job.options.hierarchical.representative, Representative::Surface);
    EXPECT_EQ(job.options.seed, std::numeric_limits<std::uint64_t>::max());
    EXPECT_EQ(job.options.reductions.at("intensity"), Reduction::Max);
    EXPECT_EQ(job.output.formats, std::vector{CloudFormat::Draco});
    EXPECT_EQ(job.output.draco.position_bits, 12U);
    EXPECT_EQ(job.output.draco.normal_bits, 8U);
    EXPECT_EQ(job.output.draco.attribute_bits, 9U);
    EXPECT_EQ(job.output.draco.compression_level, 10U);
    EXPECT_EQ(job.output.draco.coding, DracoCoding::KdTree);
}

TEST(JobRequest, TakesEveryFieldOfAPyramidJob) {
    const JobRequest request = job_request_from_json(pyramid_with(
        R"("levels": [1000, 1e4], "representative": "centroid", "formats": ["ply"],
           "draco": {"precision": 0.5})"));
    EXPECT_EQ(type_name(request), "pyramid");
    const auto& job = std::get<PyramidJob>(request.job);
    EXPECT_EQ(job.options.sizes, (std::vector<std::uint64_t>{1000, 10000}));
    EXPECT_EQ(job.options.representative, Representative::Centroid);
    EXPECT_EQ(job.output.formats, std::vector{CloudFormat::Ply});
    EXPECT_EQ(job.output.draco.precision, 0.5);
}

TEST(JobRequest, HasTheDefaultsOfCore) {
    const auto simplify =
        std::get<SimplifyJob>(job_request_from_json(simplify_with(R"("ratio": 0.01)")).job);
    EXPECT_EQ(simplify.options.method, SimplifyOptions{}.method);
    EXPECT_EQ(simplify.output.formats, std::vector{CloudFormat::Ply});
    EXPECT_EQ(simplify.output.draco.position_bits, DracoEncodeOptions{}.position_bits);

    const auto pyramid = std::get<PyramidJob>(job_request_from_json(pyramid_with("")).job);
    EXPECT_EQ(pyramid.options.ratio, LodPyramidOptions{}.ratio);
    EXPECT_EQ(pyramid.output.formats, (std::vector{CloudFormat::Draco, CloudFormat::Ply}));
}

TEST(JobRequest, ThatIsRefusedNamesFieldAndValueAndWhatIsExpected) {
    const std::pair<std::string, std::string> cases[] = {
        {simplify_with(R"("points": -3)"), "points: -3: expected an integer of at least 1"},
        {simplify_with(R"("points": 0)"), "points: 0: expected an integer of at least 1"},
        {simplify_with(R"("points": 2.5)"), "points: 2.5: expected an integer of at least 1"},
        {simplify_with(R"("points": "5")"), "points: \"5\": expected an integer of at least 1"},
        {simplify_with(R"("points": null)"), "points: null: expected an integer of at least 1"},
        {simplify_with(R"("ratio": [1])"), "ratio: a list of 1: expected a number"},
        {simplify_with(R"("points": 5, "representative": "mean")"),
         "representative: \"mean\": expected one of surface, centroid, nearest"},
        {simplify_with(R"("points": 5, "reductions": {"w": "sum"})"),
         "reductions.w: \"sum\": expected one of mean, nearest, min, max, mode"},
        {simplify_with(R"("points": 5, "draco": {"position_bits": 31})"),
         "draco.position_bits: 31: expected an integer of 0 to 30"},
        {simplify_with(R"("points": 5, "draco": {"precision": 0})"),
         "draco.precision: 0: expected a length above 0, in input units"},
        {simplify_with(R"("points": 5, "draco": {"precision": 1, "position_bits": 8})"),
         "draco.precision: stands instead of position_bits: give one of the two"},
        {simplify_with(R"("points": 5, "draco": {"bits": 8})"),
         "draco.bits: unknown field: expected one of attribute_bits, coding, compression_level, "
         "normal_bits, position_bits, precision"},
        {pyramid_with(R"("levels": [10, "x"])"),
         "levels[1]: \"x\": expected an integer of at least 1"},
        {pyramid_with(R"("levels": [])"), "levels: a list of 0: expected at least one size"},
        {pyramid_with(R"("levels": [10], "ratio": 4)"),
         "levels: stands instead of ratio and base_points: give one form"},
        {pyramid_with(R"("formats": [])"), "formats: a list of 0: expected at least one format"},
        {pyramid_with(R"("formats": ["ply", "ply"])"),
         "formats[1]: \"ply\": expected each format once"},
        {R"({"input": ")" + kInput + "\"}", "type: missing: this field is required"},
        {R"({"type": "simplify", "input": "abc", "points": 1})",
         "input: \"abc\": expected the id of a cloud: 64 lower-case hexadecimal digits"},
        {R"({"type": "magic", "input": ")" + kInput + "\"}",
         "type: \"magic\": expected simplify or pyramid"},
        {"[]", "JSON: a list of 0: expected an object"},
        {"", "JSON: not well-formed at byte 1"},
        {R"({"type": "simplify")", "JSON: not well-formed at byte 20"},
        {simplify_with(R"("points": 1, "points": 2)"), "JSON: the field \"points\" stands twice"},
        {simplify_with(R"("ratio": 1e999)"), "JSON: a number is out of range"},
        {std::string(100'000, '['), "JSON: nested more than 8 deep"},
        {std::string((1 << 20) + 1, ' '), "JSON: 1048577 bytes: expected at most 1048576"},
    };
    for (const auto& [json, expected] : cases) EXPECT_EQ(refusal(json), expected);
}

TEST(JobRequest, ThatAsksForAnUnknownFieldIsRefusedByItsName) {
    EXPECT_EQ(refusal(simplify_with(R"("point": 5)")).substr(0, 41),
              "point: unknown field: expected one of dra");
    // A field of the other type is as unknown.
    EXPECT_EQ(refusal(pyramid_with(R"("seed": 1)")).substr(0, 20), "seed: unknown field:");
}

TEST(JobRequest, IsCheckedByCoreToo) {
    EXPECT_NE(refusal(simplify_with("")), "");                              // no target
    EXPECT_NE(refusal(simplify_with(R"("points": 5, "ratio": 0.5)")), "");  // two targets
    EXPECT_NE(refusal(simplify_with(R"("ratio": 1.5)")), "");
    EXPECT_NE(refusal(pyramid_with(R"("levels": [20, 10])")), "");
    EXPECT_NE(refusal(pyramid_with(R"("ratio": 1)")), "");
}

TEST(JobRequest, WithAnUnknownMethodNamesTheFieldOnce) {
    const std::string message = refusal(simplify_with(R"("points": 5, "method": "magic")"));
    EXPECT_EQ(message.find("method"), 0U) << message;
    EXPECT_EQ(message.find("method", 1), std::string::npos) << message;
    EXPECT_NE(message.find("magic"), std::string::npos) << message;
}

TEST(JobRequest, QuotesALongValueOnlyInPart) {
    const std::string message =
        refusal(simplify_with(R"("points": ")" + std::string(5000, 'x') + '"'));
    EXPECT_LT(message.size(), 200U);
    EXPECT_NE(message.find("xxx..."), std::string::npos);
}

TEST(JobRequest, HasOneFormForEqualRequests) {
    const std::string canonical = to_json(test::simplify_request());
    EXPECT_EQ(canonical, golden("simplify_request.json"));
    const std::string otherwise = simplify_with(
        R"("draco": {"precision": 1e-3}, "points": 5e3, "format": "drc", "seed": 0,
           "reductions": {"label": "mode", "intensity": "mean"})");
    EXPECT_EQ(to_json(job_request_from_json(otherwise)), canonical);
    EXPECT_EQ(to_json(job_request_from_json(canonical)), canonical);
}

TEST(JobRequest, OfAPyramidHasOneFormForEqualRequests) {
    const std::string canonical = to_json(test::pyramid_request());
    EXPECT_EQ(canonical, golden("pyramid_request.json"));
    EXPECT_EQ(to_json(job_request_from_json(pyramid_with(""))), canonical);
    EXPECT_EQ(to_json(job_request_from_json(pyramid_with(R"("formats": ["ply", "drc"])"))),
              canonical);
    EXPECT_NE(to_json(job_request_from_json(pyramid_with(R"("formats": ["ply"])"))), canonical);
    EXPECT_NE(to_json(job_request_from_json(pyramid_with(R"("levels": [5])"))), canonical);
}

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

TEST(CloudDocument, TravelsAsTheGoldenFileSays) {
    const std::string text = to_json(test::cloud_document());
    EXPECT_EQ(text, golden("cloud.json"));
    EXPECT_EQ(to_json(cloud_document_from_json(text)), text);
}

TEST(CloudDocument, WithoutStatisticsTravelsToo) {
    CloudDocument document = test::cloud_document();
    document.statistics.reset();
    EXPECT_FALSE(cloud_document_from_json(to_json(document)).statistics);
}

TEST(CloudStatistics, TravelWithoutBoundsWhenThereAreNoPoints) {
    CloudStatistics empty = test::statistics();
    empty.bounds = {};
    EXPECT_TRUE(cloud_statistics_from_json(to_json(empty)).bounds.empty());
    const CloudStatistics full = cloud_statistics_from_json(to_json(test::statistics()));
    EXPECT_EQ(to_json(full), to_json(test::statistics()));
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
