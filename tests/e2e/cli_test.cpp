#include "stipple/codec.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/simplify.hpp"
#include "support/stipple_cli.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <limits>
#include <nlohmann/json.hpp>

namespace stipple {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::content;
using test::Outcome;
using test::StippleCli;

TEST_F(StippleCli, ParticlesTakeNoMoreMemoryBesideAFewStrayPoints) {
    PointCloud cloud = test::plane(20'000);
    for (const Vec3f& p : test::cube(40).positions)
        cloud.positions.push_back(60.0F * p - Vec3f(30, 30, 30));
    write_cloud(cloud, folder_ / "in.ply");
    const Outcome outcome =
        stipple("simplify in.ply out.ply -m particles -n 10000 --no-error --threads 1 --json -");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    // Without strays 25 MB; 420 MB when every particle was a neighbour of every other.
    EXPECT_LT(json::parse(outcome.out)["peak_memory_bytes"], 150'000'000);
}

TEST_F(StippleCli, SimplifyGivesExactlyThePointsAndTheFiguresAskedFor) {
    synthesize("in.ply", 20'000);
    const Outcome outcome =
        stipple("simplify in.ply out.ply --method hierarchical --points 777 --json -");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(read_cloud(folder_ / "out.ply").size(), 777U);

    const json figures = json::parse(outcome.out);
    EXPECT_EQ(figures["input"]["points"], 20'000);
    EXPECT_EQ(figures["output"]["points"], 777);
    EXPECT_EQ(figures["output"]["sha256"], proto::sha256_of_file(folder_ / "out.ply"));
    EXPECT_EQ(figures["method"], "hierarchical");
    EXPECT_GE(figures["threads"].get<int>(), 1);
    for (const char* part : {"decode", "simplify", "splats", "encode", "total"})
        EXPECT_GT(figures["seconds"][part].get<double>(), 0.0) << part;
    EXPECT_GT(figures["peak_memory_bytes"].get<double>(), 1e6);
    EXPECT_NE(outcome.err.find("777 points"), std::string::npos);
}

TEST_F(StippleCli, SimplifyKeepsColoursNormalsAndAttributes) {
    synthesize("in.ply", 5000);
    ASSERT_EQ(stipple("simplify in.ply out.drc --ratio 0.1").exit_code, 0);
    const PointCloud cloud = read_cloud(folder_ / "out.drc");
    EXPECT_EQ(cloud.size(), 500U);
    EXPECT_EQ(cloud.colors.size(), 500U);
    EXPECT_EQ(cloud.normals.size(), 500U);
    EXPECT_NE(find_attribute(cloud, "intensity"), nullptr);
}

TEST_F(StippleCli, EveryMethodGivesExactlyThePointsAskedFor) {
    synthesize("in.ply", 5000);
    for (const Method method : kMethods) {
        const std::string name(to_string(method));
        const Outcome outcome =
            stipple("simplify in.ply out.ply --points 333 --source-index --json - -q -m " + name);
        ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
        EXPECT_EQ(json::parse(outcome.out)["method"], name);
        const PointCloud cloud = read_cloud(folder_ / "out.ply");
        EXPECT_EQ(cloud.size(), 333U) << name;
        EXPECT_EQ(cloud.colors.size(), 333U) << name;
        for (const char* attribute : {"intensity", "radius", "source_index"})
            EXPECT_NE(find_attribute(cloud, attribute), nullptr) << name << ' ' << attribute;
    }
}

TEST_F(StippleCli, UpsampleGivesExactlyTheMorePointsAskedFor) {
    synthesize("in.ply", 2000);
    const Outcome outcome = stipple("upsample in.ply out.ply --points 5001 --json -");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(read_cloud(folder_ / "out.ply").size(), 5001U);
    EXPECT_EQ(json::parse(outcome.out)["method"], "particles");
    EXPECT_EQ(stipple("upsample in.ply fewer.ply --points 1000").exit_code, 1);
}

TEST_F(StippleCli, AnalyzeAddsThePropertiesOfTheSurface) {
    synthesize("in.ply", 2000);
    const Outcome outcome =
        stipple("analyze in.ply out.ply --k 12 --feature-lines lines.ply --json -");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const json figures = json::parse(outcome.out);
    EXPECT_EQ(figures["output"]["points"], 2000);
    EXPECT_EQ(figures["feature_lines"]["points"], read_cloud(folder_ / "lines.ply").size());
    const PointCloud cloud = read_cloud(folder_ / "out.ply");
    EXPECT_EQ(cloud.normals.size(), 2000U);
    for (const char* attribute :
         {"intensity", "variation", "density", "anisotropy", "feature_weight"})
        EXPECT_NE(find_attribute(cloud, attribute), nullptr) << attribute;
}

TEST_F(StippleCli, AnalyzeTellsHowManyFeatureLinesItFound) {
    synthesize("in.ply", 20'000);
    const Outcome some = stipple("analyze in.ply out.ply --feature-lines lines.ply");
    const std::size_t points = read_cloud(folder_ / "lines.ply").size();
    EXPECT_GT(points, 0U);
    EXPECT_NE(some.err.find(" feature lines of "), std::string::npos) << some.err;
    write_cloud(test::sphere(3000), folder_ / "smooth.ply");
    const Outcome none = stipple("analyze smooth.ply out.ply --feature-lines lines.ply");
    EXPECT_NE(none.err.find("no feature lines were found"), std::string::npos) << none.err;
    EXPECT_TRUE(stipple("analyze smooth.ply out.ply --feature-lines lines.ply -q").err.empty());
}

TEST_F(StippleCli, SimplifyGivesTheSameBytesOnOneAndTwoThreads) {
    synthesize("in.ply", 50'000);
    for (const char* format : {"ply", "drc"}) {
        const std::string end = std::string(".") + format;
        ASSERT_EQ(stipple("simplify in.ply one" + end + " --points 999 --threads 1").exit_code, 0);
        ASSERT_EQ(stipple("simplify in.ply two" + end + " --points 999 --threads 2").exit_code, 0);
        EXPECT_EQ(content(folder_ / ("one" + end)), content(folder_ / ("two" + end)));
    }
}

TEST_F(StippleCli, SimplifyWritesTheEncodingOfPlyAskedFor) {
    synthesize("in.ply", 1000);
    ASSERT_EQ(stipple("simplify in.ply out.ply -n 10 --ply-encoding ascii").exit_code, 0);
    EXPECT_TRUE(content(folder_ / "out.ply").starts_with("ply\nformat ascii 1.0\n"));
}

TEST_F(StippleCli, TakesNoAddressForAFolder) {
    const Outcome refused = stipple("pyramid in.ply https://example.org/x");
    EXPECT_NE(refused.exit_code, 0);
    EXPECT_NE(refused.err.find("expected a folder, or s3://BUCKET/PREFIX"), std::string::npos)
        << refused.err;
    EXPECT_FALSE(std::filesystem::exists(folder_ / "https:"));
}

TEST_F(StippleCli, PyramidLeavesLevelsAndAManifestThatAgree) {
    synthesize("in.ply", 20'000);
    const Outcome outcome = stipple("pyramid in.ply levels --levels 100,2000");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const json manifest = json::parse(content(folder_ / "levels/manifest.json"));
    EXPECT_EQ(manifest["complete"], true);
    ASSERT_EQ(manifest["levels"].size(), 2U);
    std::size_t files = 0;
    for (const json& level : manifest["levels"]) {
        for (const json& file : level["files"]) {
            const fs::path path = folder_.path() / "levels" / file["href"].get<std::string>();
            if (file["format"] != "glb") {
                EXPECT_EQ(read_cloud(path).size(), level["points"].get<std::size_t>());
            }
            EXPECT_EQ(proto::sha256_of_file(path), file["sha256"].get<std::string>());
            EXPECT_EQ(fs::file_size(path), file["bytes"].get<std::size_t>());
            ++files;
        }
    }
    EXPECT_EQ(files, 6U);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "levels"), {}), 8);
    const json root = json::parse(content(folder_ / "levels/tileset.json"))["root"];
    EXPECT_TRUE(fs::exists(folder_.path() / "levels" / root["content"]["uri"].get<std::string>()));
    EXPECT_EQ(root["extras"]["points"], 100);
    EXPECT_EQ(root["children"][0]["extras"]["points"], 2000);
}

TEST_F(StippleCli, EvaluateTellsTheErrorWritesMapsAndPictures) {
    write_cloud(test::sphere(3000), folder_ / "in.ply");
    PointCloud larger = test::sphere(3000);
    for (Vec3f& p : larger.positions) p *= 1.1F;
    write_cloud(larger, folder_ / "larger.ply");
    const Outcome one = stipple(
        "evaluate in.ply larger.ply --samples 3000 --json one.json --map map.ply --map map.drc "
        "--map map.png");
    ASSERT_EQ(one.exit_code, 0) << one.err;
    const json figures = json::parse(content(folder_ / "one.json"));
    EXPECT_NEAR(figures["mean"].get<double>(), 0.1, 0.002);
    EXPECT_NEAR(figures["relative"]["max"].get<double>(), 0.1 / std::sqrt(12), 0.002);
    EXPECT_NE(one.out.find("reference to candidate"), std::string::npos);
    for (const char* map : {"map.ply", "map.drc"})
        EXPECT_NE(find_attribute(read_cloud(folder_ / map), "distance"), nullptr) << map;
    EXPECT_EQ(content(folder_ / "map.png").substr(1, 3), "PNG");

    const Outcome two =
        stipple("evaluate in.ply larger.ply in.ply --samples 3000 --json - --map m.ply");
    ASSERT_EQ(two.exit_code, 0) << two.err;
    const json both = json::parse(two.out);
    EXPECT_EQ(both["candidates"][0]["mean"], figures["mean"]);
    EXPECT_LT(both["candidates"][1]["mean"].get<double>(), 0.002);
    EXPECT_TRUE(fs::exists(folder_ / "m-1.ply"));
    EXPECT_TRUE(fs::exists(folder_ / "m-2.ply"));

    EXPECT_EQ(one.out.find("compared with itself"), std::string::npos);
    EXPECT_NE(stipple("evaluate in.ply in.ply").out.find("compared with itself"),
              std::string::npos);
    EXPECT_EQ(stipple("evaluate in.ply in.ply --basis samples").out.find("compared with itself"),
              std::string::npos);

    EXPECT_EQ(stipple("evaluate in.ply").exit_code, 2);
    EXPECT_EQ(stipple("evaluate in.ply larger.ply --k 3").exit_code, 2);
    EXPECT_EQ(stipple("evaluate in.ply nothing.ply").exit_code, 1);
}

TEST_F(StippleCli, EvaluateWarnsOfCloudsThatCannotBeCompared) {
    write_cloud(test::sphere(1000), folder_ / "in.ply");
    for (const float scale : {1000.0F, 0.001F}) {
        PointCloud other = test::sphere(1000);
        for (Vec3f& p : other.positions) p *= scale;
        write_cloud(other, folder_ / "other.ply");
        const Outcome units = stipple("evaluate in.ply other.ply --json other.json");
        EXPECT_EQ(units.exit_code, 0) << units.err;
        EXPECT_NE(units.err.find("warning: other.ply: "), std::string::npos) << scale;
        EXPECT_NE(json::parse(content(folder_ / "other.json"))["warnings"].dump().find("same unit"),
                  std::string::npos);
    }
    write_cloud(test::sphere(7), folder_ / "few.ply");
    const Outcome few = stipple("evaluate few.ply in.ply --json -");
    EXPECT_EQ(few.exit_code, 0) << few.err;
    EXPECT_NE(json::parse(few.out)["warnings"].dump().find("reference of 7 points"),
              std::string::npos);
    write_cloud(PointCloud{}, folder_ / "empty.ply");
    for (const char* which : {"in.ply empty.ply", "empty.ply in.ply"}) {
        const Outcome empty = stipple(std::string("evaluate ") + which);
        EXPECT_EQ(empty.exit_code, 1);
        EXPECT_EQ(empty.err, "stipple: empty.ply: the file holds no points\n");
    }
}

TEST_F(StippleCli, EveryResultTellsItsErrorUnlessToldNotTo) {
    synthesize("in.ply", 20'000);
    const Outcome told = stipple("simplify in.ply out.ply --points 500 --json -");
    const json error = json::parse(told.out)["error"];
    EXPECT_GT(error["mean"].get<double>(), 0);
    EXPECT_GE(error["max"], error["mean"]);
    EXPECT_EQ(error["samples"], 160);
    EXPECT_NE(told.err.find("error: mean"), std::string::npos);
    const json without =
        json::parse(stipple("simplify in.ply out.ply --points 500 --no-error --json -").out);
    EXPECT_FALSE(without.contains("error"));
    EXPECT_EQ(without["seconds"]["error"], 0.0);
}

TEST_F(StippleCli, SimplifyWithinAnErrorSaysWhatWasMeasured) {
    synthesize("in.ply", 2000);
    const Outcome outcome =
        stipple("simplify in.ply out.ply --max-error 3% -m hierarchical --json -");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const json bound = json::parse(outcome.out)["bound"];
    EXPECT_LE(bound["forward"].get<double>(), bound["max_error"].get<double>());
    EXPECT_LE(bound["backward"].get<double>(), bound["max_error"].get<double>());
    EXPECT_NE(outcome.err.find("largest distance"), std::string::npos);
    EXPECT_LT(read_cloud(folder_ / "out.ply").size(), 2000U);
}

TEST_F(StippleCli, CurveDrawsAndTellsTheErrorAtEachCount) {
    synthesize("in.ply", 2000);
    const Outcome outcome = stipple("curve in.ply --points 100,400 --plot c.svg --json -");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const json curve = json::parse(outcome.out)["curve"];
    ASSERT_EQ(curve.size(), 2U);
    EXPECT_EQ(curve[0]["points"], 100);
    EXPECT_GT(curve[0]["forward"]["mean"].get<double>(), curve[1]["forward"]["mean"].get<double>());
    const std::string picture = content(folder_ / "c.svg");
    EXPECT_TRUE(picture.starts_with("<svg"));
    EXPECT_TRUE(picture.ends_with("</svg>\n"));
    EXPECT_EQ(outcome.err.find("left out"), std::string::npos);
    EXPECT_NE(stipple("curve in.ply --points 100,2k,5000")
                  .err.find("left out 2,000, 5,000: the cloud has 2,000 points"),
              std::string::npos);
}

TEST_F(StippleCli, InspectTellsPointsBoundsAttributesAndHash) {
    synthesize("in.ply", 3000);
    const Outcome outcome = stipple("inspect in.ply --json figures.json");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const json figures = json::parse(content(folder_ / "figures.json"));
    EXPECT_EQ(figures["points"], 3000);
    EXPECT_EQ(figures["encoding"], "binary_little_endian");
    EXPECT_EQ(figures["sha256"], proto::sha256_of_file(folder_ / "in.ply"));
    EXPECT_EQ(figures["attributes"].size(), 3U);
    EXPECT_GT(figures["spacing"].get<double>(), 0.1);
    EXPECT_NE(outcome.out.find("3,000"), std::string::npos);
}

TEST_F(StippleCli, ConvertLeavesOutWhatTheFormatCannotHoldAndSaysSo) {
    std::ofstream(folder_ / "in.ply")
        << "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
           "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
           "0 0 0\nnan nan nan\n1 0 0\n0 1 0\n3 0 2 3\n";
    for (const char* const name : {"out.copc.laz", "out.stpc", "out.drc"}) {
        const Outcome outcome = stipple("convert in.ply " + std::string(name) + " --json -");
        ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
        EXPECT_NE(outcome.err.find("removed 1 point without finite coordinates"), std::string::npos)
            << outcome.err;
        EXPECT_NE(outcome.err.find("left out face.vertex_indices"), std::string::npos)
            << outcome.err;
        const json figures = json::parse(outcome.out);
        EXPECT_EQ(figures["input"]["removed"]["non_finite"], 1);
        EXPECT_EQ(figures["output"]["points"], 3);
    }
    for (const char* const name : {"out.stpc", "out.drc"})
        EXPECT_EQ(read_cloud(folder_ / name).size(), 3U) << name;
    const Outcome kept = stipple("convert in.ply out.ply");
    EXPECT_EQ(kept.err.find("removed"), std::string::npos);
    EXPECT_NE(kept.err.find("left out face.vertex_indices"), std::string::npos) << kept.err;
    EXPECT_EQ(read_cloud(folder_ / "out.ply").size(), 4U);
}

TEST_F(StippleCli, ConvertMakesNormalsZeroThatNoGridHoldsAndSaysSo) {
    PointCloud cloud = test::sphere(100);
    cloud.normals = cloud.positions;
    cloud.normals[7].y() = std::numeric_limits<float>::quiet_NaN();
    write_cloud(cloud, folder_ / "in.ply");
    for (const char* const name : {"out.drc", "out.stpc"}) {
        const Outcome outcome = stipple("convert in.ply " + std::string(name) + " --json -");
        ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
        const std::string lost = "1 normal that is not finite";
        EXPECT_NE(outcome.err.find("left out " + lost), std::string::npos) << outcome.err;
        EXPECT_EQ(json::parse(outcome.out)["input"]["skipped"], json::array({lost}));
        EXPECT_EQ(read_cloud(folder_ / name).size(), 100U);
    }
    EXPECT_EQ(stipple("convert in.ply out.ply").err.find("normal"), std::string::npos);
}

TEST_F(StippleCli, TellsWhatTheCoordinatesOfADracoFileAreRelativeTo) {
    PointCloud cloud = test::sphere(2000);
    cloud.origin = Vec3d(500'000, 5'000'000, 128);
    cloud.double_precision = true;
    write_cloud(cloud, folder_ / "in.ply");
    for (const std::string command : {"convert in.ply out.drc", "simplify in.ply out.drc -n 500"}) {
        const Outcome outcome = stipple(command);
        ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
        const PointCloud written = read_cloud(folder_ / "out.drc");
        std::ostringstream expected;
        expected << std::setprecision(15) << "coordinates relative to " << written.origin.x() << ' '
                 << written.origin.y() << ' ' << written.origin.z();
        EXPECT_NE(outcome.err.find(expected.str()), std::string::npos) << outcome.err;
        EXPECT_NE(outcome.err.find("rounded by at most 6"), std::string::npos)
            << "2 / (2^14 - 1) / 2: " << outcome.err;
    }
    EXPECT_EQ(stipple("convert in.ply out.ply").err.find("relative"), std::string::npos);
}

TEST_F(StippleCli, ConvertLeavesOutOfAStreamWhatStandsAtOnePlaceAndSaysSo) {
    std::string text =
        "ply\nformat ascii 1.0\nelement vertex 200001\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n1 2 3\n";
    for (int i = 0; i < 200'000; ++i) text += "0 0 0\n";
    std::ofstream(folder_ / "in.ply") << text;
    const Outcome outcome = stipple("convert in.ply out.stpc --json -");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_NE(outcome.err.find("removed 199,999 duplicates"), std::string::npos) << outcome.err;
    EXPECT_EQ(json::parse(outcome.out)["input"]["removed"]["duplicates"], 199'999);
    EXPECT_EQ(read_cloud(folder_ / "out.stpc").size(), 2U);
}

TEST_F(StippleCli, ReadsAStreamOfMoreAttributesThanAServerTakes) {
    PointCloud cloud = test::sphere(50);
    for (int i = 0; i < 70; ++i)
        cloud.attributes.push_back({"a" + std::to_string(i), std::vector<float>(50, 0.5F)});
    write_cloud(cloud, folder_ / "in.ply");
    ASSERT_EQ(stipple("convert in.ply out.stpc").exit_code, 0);
    EXPECT_EQ(stipple("inspect out.stpc").exit_code, 0);
    const Outcome outcome = stipple("convert out.stpc back.ply");
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    const DecodeLimits any{.max_attributes = DecodeLimits::kAnyAttributes};
    EXPECT_EQ(read_cloud(folder_ / "back.ply", any).attributes.size(), 70U);
}

TEST_F(StippleCli, ConvertTellsHowManyPointsTheWholeOfACutStreamHas) {
    synthesize("in.ply", 3000);
    ASSERT_EQ(stipple("convert in.ply in.stpc").exit_code, 0);
    fs::resize_file(folder_ / "in.stpc", fs::file_size(folder_ / "in.stpc") / 2);
    const Outcome all = stipple("convert in.stpc all.ply");
    EXPECT_TRUE(all.err.starts_with("3,000 ")) << all.err;
    EXPECT_LT(read_cloud(folder_ / "all.ply").size(), 3000U);
    ASSERT_EQ(stipple("convert in.stpc first.ply --points 3000").exit_code, 0);
    EXPECT_EQ(content(folder_ / "all.ply"), content(folder_ / "first.ply"));
}

TEST_F(StippleCli, ConvertThereAndBackKeepsEveryPoint) {
    synthesize("in.ply", 3000);
    ASSERT_EQ(stipple("convert in.ply mid.drc --position-bits 0 --coding sequential").exit_code, 0);
    ASSERT_EQ(stipple("convert mid.drc out.ply").exit_code, 0);
    EXPECT_EQ(read_cloud(folder_ / "in.ply").positions, read_cloud(folder_ / "out.ply").positions);
}

TEST_F(StippleCli, ReadsAFileByItsContentWhateverItsName) {
    synthesize("in.drc", 1000);
    fs::rename(folder_ / "in.drc", folder_ / "in.ply");
    EXPECT_EQ(stipple("simplify in.ply out.ply -n 10").exit_code, 0);
}

TEST_F(StippleCli, OutliersAreRemovedAndTold) {
    synthesize("scan.ply", 2000);
    PointCloud cloud;
    cloud.positions = read_cloud(folder_ / "scan.ply").positions;
    cloud.positions.push_back(Vec3f::Constant(1e6F));
    write_cloud(cloud, folder_ / "in.ply");
    const Outcome outcome = stipple("simplify --remove-outliers in.ply out.ply -n 5000 --json -");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_NE(outcome.err.find("removed 1 outlier\n"), std::string::npos) << outcome.err;
    const json figures = json::parse(outcome.out);
    EXPECT_EQ(figures["input"]["removed"]["outliers"], 1);
    EXPECT_EQ(figures["output"]["points"], 2000);
}

TEST_F(StippleCli, WhatIsLostIsToldWhereNoTerminalIsToo) {
    std::ofstream(folder_ / "in.ply")
        << "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
           "property float z\nend_header\n0 0 0\n1 0 0\nnan 0 0\n0 1 0\n";
    const Outcome outcome = stipple("simplify in.ply out.ply -n 9 --json -");
    EXPECT_NE(outcome.err.find("removed 1 point without finite coordinates"), std::string::npos)
        << outcome.err;
    EXPECT_NE(outcome.err.find("9 points were requested; the cloud has only"), std::string::npos)
        << outcome.err;
    EXPECT_EQ(json::parse(outcome.out)["warnings"],
              json::array({"9 points were requested; the cloud has only 3"}));
}

TEST_F(StippleCli, TextOfAFileDoesNothingToTheTerminal) {
    std::ofstream(folder_ / "in.ply")
        << "ply\nformat ascii 1.0\ncomment odd \x01\x1b[31m \xc2\x9bK red\nelement vertex 1\n"
           "property float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n";
    const Outcome outcome = stipple("inspect in.ply");
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.out.find_first_of("\x01\x1b"), std::string::npos) << outcome.out;
    EXPECT_NE(outcome.out.find("odd   [31m  K red"), std::string::npos) << outcome.out;
}

TEST_F(StippleCli, NamesThatAreNoUtf8DoForPicturesToo) {
    synthesize("in.ply", 1000);
    fs::copy_file(folder_ / "in.ply", folder_ / "scan_\xe9.ply");
    const Outcome map = stipple("evaluate in.ply scan_\xe9.ply --map map.png");
    EXPECT_EQ(map.exit_code, 0) << map.err;
    const Outcome plot = stipple("curve scan_\xe9.ply --points 50,100 --plot c.svg");
    EXPECT_EQ(plot.exit_code, 0) << plot.err;
    EXPECT_NE(content(folder_ / "c.svg").find("scan_\xef\xbf\xbd.ply"), std::string::npos);
    const Outcome potree = stipple("pyramid scan_\xe9.ply levels --layout potree");
    EXPECT_EQ(potree.exit_code, 0) << potree.err;
}

TEST_F(StippleCli, ADamagedLevelOfASliceIsNamed) {
    synthesize("in.ply", 2000);
    ASSERT_EQ(stipple("pyramid in.ply levels --levels 100 --formats ply").exit_code, 0);
    std::ofstream(folder_ / "levels/level-0.ply") << "ply\n";
    const Outcome outcome = stipple("slice levels out.ply -n 5");
    EXPECT_EQ(outcome.exit_code, 1);
    EXPECT_TRUE(outcome.err.starts_with("stipple: levels/level-0.ply: ")) << outcome.err;
}

TEST_F(StippleCli, WhatCannotBeEncodedIsNamed) {
    write_cloud(PointCloud{}, folder_ / "in.ply");
    for (const std::string name : {"out.laz", "out.stpc"}) {
        const Outcome outcome = stipple("convert in.ply " + name);
        EXPECT_EQ(outcome.exit_code, 1);
        EXPECT_TRUE(outcome.err.starts_with("stipple: " + name + ": ")) << outcome.err;
        EXPECT_EQ(files(), std::vector<std::string>{"in.ply"});
    }
}

TEST_F(StippleCli, HelpThatCannotBeWrittenIsAnError) {
    const Outcome outcome = stipple("--help >&- 2> told.txt; test $? = 1");
    EXPECT_EQ(outcome.exit_code, 0);
    EXPECT_EQ(content(folder_ / "told.txt"), "stipple: standard output: cannot be written\n");
}

TEST_F(StippleCli, UsageErrorsExitWithTwoAndNameTheRemedy) {
    const Outcome outcome = stipple("simplify in.ply out.ply");
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_NE(outcome.err.find("--points"), std::string::npos);
    EXPECT_EQ(stipple("simplify in.ply").exit_code, 2);
    for (const auto& [arguments, told] : std::vector<std::pair<std::string, std::string>>{
             {"simplify in.ply out.ply -m voxel", "--voxel-size"},
             {"simplify in.ply out.ply -n 5 -r 10%", "give one of them"},
             {"simplify in.ply out.ply -n 5kg", "5kg: expected points"},
             {"simplify in.ply out.ply -r half", "half: expected a ratio"},
             {"simplify in.ply out.ply -n 5 --server ''", "expected http://HOST:PORT"},
             {"slice levels out.ply --bytes 5kg", "5kg: expected bytes"}}) {
        const Outcome refused = stipple(arguments);
        EXPECT_EQ(refused.exit_code, 2) << arguments;
        EXPECT_NE(refused.err.find(told), std::string::npos) << refused.err;
    }
    EXPECT_EQ(stipple("simplify missing.ply out.ply -n 5").exit_code, 1);
    const Outcome many = stipple("simplify in.ply out.ply -n 5 --threads 100000");
    EXPECT_EQ(many.exit_code, 2);
    EXPECT_NE(many.err.find("1024"), std::string::npos) << many.err;
}

TEST_F(StippleCli, ReadsItsOwnFilesOfAnyNumberOfAttributes) {
    PointCloud cloud = test::sphere(300);
    for (int i = 0; i < 70; ++i)
        cloud.attributes.push_back({"a" + std::to_string(i), std::vector<float>(300, 1.0F)});
    write_cloud(cloud, folder_ / "in.ply");
    for (const std::string command :
         {"inspect in.ply", "convert in.ply out.drc", "simplify out.drc out.ply -n 50",
          "evaluate in.ply out.ply", "pyramid in.ply levels --levels 50,300 --formats ply",
          "slice levels out.ply -n 20"}) {
        const Outcome outcome = stipple(command);
        EXPECT_EQ(outcome.exit_code, 0) << command << ": " << outcome.err;
    }
}

TEST_F(StippleCli, InspectTellsABoxThatHoldsAllPoints) {
    PointCloud cloud = test::sphere(3'000);
    cloud.origin = {467'123.456'78, 5'432'198.765'43, -412.3};
    cloud.double_precision = true;
    write_cloud(cloud, folder_ / "in.ply");
    const std::string told = stipple("inspect in.ply").out;
    std::string box;
    for (const std::string row : {"\nfrom", "\nto"}) {
        const auto at = told.find(row);
        ASSERT_NE(at, told.npos) << told;
        const auto begin = told.find_first_not_of(' ', at + row.size());
        for (const char c : told.substr(begin, told.find('\n', begin) - begin))
            if (c != ' ') box += c;
        box += row == "\nfrom" ? "," : "";
    }
    EXPECT_LT(box.size(), 80U) << box;
    ASSERT_EQ(stipple("pyramid in.ply levels --levels 3000 --formats ply").exit_code, 0);
    const Outcome slice = stipple("slice levels out.ply -n 5000 --box=" + box);
    EXPECT_EQ(read_cloud(folder_ / "out.ply").size(), 3'000U) << slice.err << box;
}

TEST_F(StippleCli, AFolderForScratchFilesThatIsNotThereIsNamed) {
    synthesize("in.ply", 100);
    const Outcome outcome = stipple("curve in.ply", "TMPDIR=/nowhere ");
    EXPECT_EQ(outcome.exit_code, 1);
    EXPECT_EQ(outcome.err,
              "stipple: TMPDIR /nowhere: expected a folder that can be written; set it to one\n");
}

TEST_F(StippleCli, AServerThatIsNotThereIsNamedWithTheRemedy) {
    synthesize("in.ply", 100);
    const Outcome outcome = stipple("simplify in.ply out.ply -n 5 --server http://127.0.0.1:1");
    EXPECT_EQ(outcome.exit_code, 1);
    EXPECT_NE(outcome.err.find("http://127.0.0.1:1"), std::string::npos);
    EXPECT_NE(outcome.err.find("stippled serve"), std::string::npos);
    EXPECT_EQ(files(), std::vector<std::string>{"in.ply"});
}

TEST_F(StippleCli, WhatAServerSaysBeforeItHasTheWholeFileIsTold) {
    const test::StippledProcess server({"--max-upload", "1MB"});
    write_cloud(test::sphere(2'000'000), folder_ / "in.ply");
    const Outcome outcome = stipple("simplify in.ply out.ply -n 5 --server " + server.url());
    EXPECT_EQ(outcome.exit_code, 1);
    EXPECT_NE(outcome.err.find("at most 1000000 are accepted"), std::string::npos) << outcome.err;
}

TEST_F(StippleCli, AServerThatWantsAKeyIsToldWithTheOptionForIt) {
    std::ofstream(folder_ / "keys.json")
        << R"([{"tenant": "ada", "scopes": ["read"], "key_sha256": ")" << std::string(64, '0')
        << R"("}])";
    const test::StippledProcess server({"--api-keys", (folder_ / "keys.json").string()});
    synthesize("in.ply", 100);
    for (const char* const key : {"", " --api-key unknown"}) {
        for (const char* const command : {"simplify in.ply out.ply", "slice 0123 out.ply"}) {
            const Outcome outcome =
                stipple(std::string(command) + " -n 5 --server " + server.url() + key);
            EXPECT_EQ(outcome.exit_code, 1);
            EXPECT_NE(outcome.err.find("--api-key or in STIPPLE_API_KEY"), std::string::npos)
                << outcome.err;
        }
    }
}

TEST_F(StippleCli, IgeaComesOutWithTheCountAskedFor) {
    const auto igea = test::shared_file("models/igea.ply");
    if (!igea) GTEST_SKIP() << "the shared scans are not here";
    const Outcome outcome =
        stipple("simplify '" + igea->string() + "' out.drc --points 5000 --json -");
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(json::parse(outcome.out)["input"]["points"], 134'345);
    EXPECT_EQ(read_cloud(folder_ / "out.drc").size(), 5000U);
}

}  // namespace
}  // namespace stipple
