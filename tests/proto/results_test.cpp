#include "stipple/proto/job_process.hpp"

#include "documents.hpp"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace stipple::proto {
namespace {

using test::golden;

TEST(TileErrors, AreRaisedToThoseOfTheTilesBelow) {
    Results pyramid;
    const auto add = [&](std::optional<std::uint32_t> parent, double mean, double max, double p99) {
        OutputFile file{CloudFormat::Glb, 1, "", "", LodTile{}};
        file.tile->parent = parent;
        file.tile->error = {.mean = mean, .max = max, .p99 = p99, .samples = 9};
        pyramid.levels.emplace_back().files = {{CloudFormat::Ply, 1, "", ""}, std::move(file)};
    };
    add({}, 1, 5, 2);
    add(0, 0.5, 6, 2);
    add(0, 0.25, 1, 0.5);
    add(1, 0.75, 1, 3);
    add(2, 0.125, 0.5, 0.25);
    raise_tile_errors(pyramid);
    const auto error = [&](std::size_t i) { return pyramid.levels[i].files[1].tile->error; };
    EXPECT_EQ(error(0).mean, 1);
    EXPECT_EQ(error(0).max, 6);
    EXPECT_EQ(error(0).p99, 3);
    EXPECT_EQ(error(1).mean, 0.75);
    EXPECT_EQ(error(1).max, 6);
    EXPECT_EQ(error(1).p99, 3);
    EXPECT_EQ(error(2).mean, 0.25);
    EXPECT_EQ(error(3).mean, 0.75);
    EXPECT_EQ(error(0).samples, 9U);
}

TEST(Results, TravelAsTheGoldenFileSays) {
    const std::string text = to_json(test::pyramid_results());
    EXPECT_EQ(text, golden("pyramid_results.json"));
    EXPECT_EQ(to_json(results_from_json(text)), text);
}

TEST(Results, OfAFailedJobTravelWithItsProblem) {
    Results results = test::pyramid_results();
    results.complete = false;
    results.problem = problem_from(ErrorCode::TooLarge, "80409 tiles");
    const Results back = results_from_json(to_json(results));
    ASSERT_TRUE(back.problem);
    EXPECT_EQ(back.problem->detail, "80409 tiles");
    EXPECT_EQ(to_json(back), to_json(results));
}

TEST(Results, ThatAreStillToComeTravelWithoutSourceAndCost) {
    const Results results{.request = test::simplify_request(),
                          .source = {},
                          .levels = {},
                          .complete = false,
                          .cost = {}};
    const Results back = results_from_json(to_json(results));
    EXPECT_FALSE(back.complete);
    EXPECT_FALSE(back.source);
    EXPECT_FALSE(back.cost);
    EXPECT_TRUE(back.levels.empty());
}

TEST(Results, WhoseSchemaIsThatOfAnotherJobAreRefused) {
    auto json = nlohmann::json::parse(to_json(test::pyramid_results()));
    json["schema"] = "stipple-results/1";
    EXPECT_EQ(test::refusal(results_from_json, json.dump(), ErrorCode::MalformedInput),
              "schema: \"stipple-results/1\": expected stipple-pyramid/1");
}

TEST(Results, ThatAreMalformedAreRefusedByThePathOfTheField) {
    auto json = nlohmann::json::parse(to_json(test::pyramid_results()));
    json["levels"][1]["files"][1]["bytes"] = "many";
    EXPECT_EQ(test::refusal(results_from_json, json.dump(), ErrorCode::MalformedInput),
              "levels[1].files[1].bytes: \"many\": expected a whole number");
}

TEST(Results, WhoseFilesHaveNoHashAreRefused) {
    auto json = nlohmann::json::parse(to_json(test::pyramid_results()));
    for (const char* name : {"../../etc/passwd", "/home/ada/scan", "ABCDEF", ""}) {
        json["levels"][0]["files"][0]["sha256"] = name;
        EXPECT_EQ(test::refusal(results_from_json, json.dump(), ErrorCode::MalformedInput),
                  "levels[0].files[0].sha256: \"" + std::string(name) +
                      "\": expected 64 lower-case hexadecimal digits");
    }
}

TEST(Results, OfTilesWhoseParentsStandBehindThemAreRefused) {
    const auto whole = nlohmann::json::parse(to_json(test::pyramid_results()));
    for (auto json = whole; const std::uint32_t parent : {1'000U, 0U}) {
        int tiles = 0;
        for (auto& level : json["levels"])
            for (auto& file : level["files"])
                if (file.contains("tile") && tiles++ == 0) file["tile"]["parent"] = parent;
        ASSERT_GT(tiles, 0);
        EXPECT_NE(
            test::refusal(results_from_json, json.dump(), ErrorCode::MalformedInput)
                .find("expected the parent of tile 0 before it, not " + std::to_string(parent)),
            std::string::npos);
    }
}

TEST(Results, EveryFieldIsNeeded) {
    const auto whole = nlohmann::json::parse(to_json(test::pyramid_results()));
    for (const auto& [name, value] : whole.items()) {
        if (name == "source" || name == "cost") continue;  // absent until known
        auto json = whole;
        json.erase(name);
        EXPECT_EQ(test::refusal(results_from_json, json.dump(), ErrorCode::MalformedInput),
                  name + ": missing: this field is required");
    }
}

TEST(JobSpec, TravelsAsTheGoldenFileSays) {
    const std::string text = to_json(test::job_spec());
    EXPECT_EQ(text, golden("job_spec.json"));
    EXPECT_EQ(to_json(job_spec_from_json(text)), text);
}

TEST(JobReport, OfALevelOfTheMostTilesIsRead) {
    OutputCloud level;
    level.level = 20;
    level.points = 4'000'000'000;
    level.bounds = {Vec3d::Constant(-1e7 / 3), Vec3d::Constant(1e7 / 3)};
    for (std::uint32_t i = 0; i < LodTiler::kMostTiles; ++i) {
        // As long as they come: floats have nine digits, doubles seventeen.
        const double number = -1e-7 / (3.0 + i), figure = static_cast<float>(-number);
        LodTile tile;
        tile.parent = LodTiler::kMostTiles;
        tile.level = level.level;
        tile.points = 65'536;
        tile.bits = 16;
        tile.offset = Vec3d::Constant(number);
        tile.step = -number;
        tile.last = {65'535, 65'535, 65'535};
        tile.error = {.mean = figure,
                      .max = figure,
                      .p99 = figure,
                      .mean_confidence = figure,
                      .samples = 131'072};
        tile.spacing = tile.cover_radius = figure;
        level.files.push_back({CloudFormat::Glb, 1'000'000, std::string(64, 'a'),
                               "level-20-" + std::string(5, '9') + ".glb", tile});
    }
    const std::string line = to_json(JobReport(level));
    EXPECT_LT(line.size(), kMaxReportBytes);
    const auto read = std::get<OutputCloud>(job_report_from_json(line));
    EXPECT_EQ(read.files.size(), LodTiler::kMostTiles);
}

TEST(JobReport, TravelsOnOneLineForEachOfItsKinds) {
    const JobReport progress = JobProgress{"decode", 12.5};
    CloudStatistics source = test::statistics();
    source.comments = {"two\nlines", std::string("a\0b", 3)};
    const std::vector<JobReport> reports = {progress, source, test::output_cloud(),
                                            test::job_cost(),
                                            problem_from(ErrorCode::TooLarge, "too large")};
    for (const JobReport& report : reports) {
        const std::string line = to_json(report);
        EXPECT_EQ(line.find('\n'), std::string::npos);
        EXPECT_EQ(to_json(job_report_from_json(line)), line);
    }
    EXPECT_EQ(to_json(progress), R"({"progress":{"stage":"decode","percent":12.5}})");
}

TEST(JobReport, WithNoneOrTwoFieldsIsRefused) {
    EXPECT_EQ(test::refusal(job_report_from_json, "{}", ErrorCode::MalformedInput),
              "JSON: expected exactly one report");
    std::string both = to_json(JobReport(JobProgress{"decode", 1}));
    both.back() = ',';
    both += to_json(JobReport(test::job_cost())).substr(1);
    EXPECT_EQ(test::refusal(job_report_from_json, both, ErrorCode::MalformedInput),
              "JSON: expected exactly one report");
    EXPECT_NE(test::refusal(job_report_from_json, R"({"cots": 1})", ErrorCode::MalformedInput)
                  .find("cots"),
              std::string::npos);
}

TEST(JobReport, CutAtAnyByteIsRefused) {
    const std::string line = to_json(JobReport(test::output_cloud()));
    for (std::size_t length = 0; length < line.size(); ++length) {
        EXPECT_NE(
            test::refusal(job_report_from_json, line.substr(0, length), ErrorCode::MalformedInput),
            "")
            << length;
    }
}

}  // namespace
}  // namespace stipple::proto
