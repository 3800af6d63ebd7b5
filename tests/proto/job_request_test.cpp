#include "stipple/proto/job_request.hpp"

#include "documents.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

namespace stipple::proto {
namespace {

using test::golden;
using test::kInput;

/// A request with `fields` beside type and input.
std::string request_with(const std::string& type, const std::string& fields) {
    return R"({"type": ")" + type + R"(", "input": ")" + kInput + "\"" +
           (fields.empty() ? "" : ", " + fields) + "}";
}

std::string simplify_with(const std::string& fields) {
    return request_with("simplify", fields);
}

std::string pyramid_with(const std::string& fields) {
    return request_with("pyramid", fields);
}

/// `item` so many times, its `#` replaced by its number.
std::string repeated(int times, const std::string& item) {
    std::string list;
    for (int i = 0; i < times; ++i) {
        std::string one = item;
        if (const auto at = one.find('#'); at != one.npos) one.replace(at, 1, std::to_string(i));
        list += (i == 0 ? "" : ",") + one;
    }
    return list;
}

std::string refusal(const std::string& json) {
    return test::refusal(job_request_from_json, json, ErrorCode::InvalidArgument);
}

SimplifyJob simplify_job(const std::string& fields) {
    return std::get<SimplifyJob>(job_request_from_json(simplify_with(fields)).job);
}

TEST(JobRequest, TakesEveryFieldOfASimplifyJob) {
    const JobRequest request = job_request_from_json(simplify_with(
        R"("method": "hierarchical", "max_cluster_size": 50, "max_variation": 0.05,
           "representative": "surface", "seed": 18446744073709551615,
           "splats": "ellipse", "source_index": true,
           "reductions": {"intensity": "max"}, "format": "drc",
           "draco": {"position_bits": 12, "normal_bits": 8, "attribute_bits": 9,
                     "compression_level": 10, "coding": "kd-tree"})"));
    EXPECT_EQ(request.input, kInput);
    EXPECT_EQ(type_name(request), "simplify");
    const auto& job = std::get<SimplifyJob>(request.job);
    EXPECT_EQ(job.options.hierarchical.max_cluster_size, 50U);
    EXPECT_EQ(job.options.hierarchical.max_variation, 0.05);
    EXPECT_EQ(job.options.hierarchical.representative, Representative::Surface);
    EXPECT_EQ(job.added.splats, SplatAttributes::Ellipse);
    EXPECT_TRUE(job.added.source_index);
    EXPECT_EQ(job.options.seed, std::numeric_limits<std::uint64_t>::max());
    EXPECT_EQ(job.options.reductions.at("intensity"), Reduction::Max);
    EXPECT_EQ(job.output.formats, std::vector{CloudFormat::Draco});
    EXPECT_EQ(job.output.draco.position_bits, 12U);
    EXPECT_EQ(job.output.draco.normal_bits, 8U);
    EXPECT_EQ(job.output.draco.attribute_bits, 9U);
    EXPECT_EQ(job.output.draco.compression_level, 10U);
    EXPECT_EQ(job.output.draco.coding, DracoCoding::KdTree);
}

TEST(JobRequest, APartOfTheDiagonalReadsBackAsTheSameNumber) {
    std::mt19937_64 random(7);
    for (int i = 0; i < 100'000; ++i) {
        const double part = std::ldexp(static_cast<double>(1 + (random() >> 11U)),
                                       -53 - static_cast<int>(random() % 40));
        ASSERT_EQ(part_of_diagonal(percent_text(part)), part) << percent_text(part);
    }
    EXPECT_EQ(percent_text(0.001), "0.1%");
    EXPECT_EQ(percent_text(0.25), "25%");
    EXPECT_EQ(percent_text(1e-9), "1e-07%");
    for (const char* const text : {"", "%", "1", "1%%", "1e%", "1e-99999999999%", "nan%", "x%"})
        EXPECT_THROW(part_of_diagonal(text), Error) << text;
}

TEST(JobRequest, AMaxErrorIsALengthOrAPartOfTheDiagonal) {
    EXPECT_EQ(simplify_job(R"("max_error": 0.25)").options.max_error, 0.25);
    EXPECT_EQ(simplify_job(R"("max_error": "0.25%")").options.max_error_rel, 0.0025);
    for (const std::string value : {"0.1", "\"0.1%\"", "\"12.345678901%\"", "\"1e-3%\""}) {
        const JobRequest request = job_request_from_json(simplify_with("\"max_error\": " + value));
        const std::string canonical = to_json(request);
        const JobRequest again = job_request_from_json(canonical);
        EXPECT_EQ(to_json(again), canonical);
        EXPECT_EQ(std::get<SimplifyJob>(again.job).options.max_error_rel,
                  std::get<SimplifyJob>(request.job).options.max_error_rel);
    }
}

TEST(JobRequest, RefusesAMaxErrorThatNoCloudCanKeep) {
    for (const std::string value : {"0", "-1", "\"0%\"", "\"0.1\"", "\"%\"", "\"-1%\"", "true"})
        EXPECT_NE(refusal(simplify_with("\"max_error\": " + value)).find("max_error"),
                  std::string::npos)
            << value;
    EXPECT_NE(refusal(simplify_with(R"("max_error": 1, "points": 5)")).find("exactly one"),
              std::string::npos);
    EXPECT_NE(refusal(simplify_with(R"("max_error": 1, "method": "voxel")")).find("voxel"),
              std::string::npos);
}

TEST(JobRequest, TakesACurveAtCountsOrSoMany) {
    const JobRequest at = job_request_from_json(
        request_with("curve", R"("method": "hierarchical", "points": [10, 100])"));
    EXPECT_EQ(std::get<CurveJob>(at.job).options.points, (std::vector<std::uint64_t>{10, 100}));
    EXPECT_EQ(to_json(job_request_from_json(to_json(at))), to_json(at));
    const JobRequest many = job_request_from_json(request_with("curve", R"("count": 5)"));
    EXPECT_EQ(std::get<CurveJob>(many.job).options.count, 5U);
    EXPECT_EQ(to_json(job_request_from_json(to_json(many))), to_json(many));
    for (const char* const fields :
         {R"("count": 1)", R"("points": [])", R"("points": [5, 5])", R"("points": [5], "count": 2)",
          R"("method": "voxel")", R"("ratio": 0.5)", R"("method": "particles", "k": 7)"})
        EXPECT_NE(refusal(request_with("curve", fields)), "") << fields;
}

TEST(JobRequest, TakesTheOptionsOfMultiphaseAndIterative) {
    const std::string fields =
        R"("points": 9, "k": 12, "placement": "end-point", "max_displacement": 0.5,
           "color_weight": 0.25, "attribute_weights": {"intensity": 2})";
    for (const std::string method : {"multiphase", "iterative"}) {
        const SimplifyJob job = simplify_job(R"("method": ")" + method + R"(", )" + fields);
        EXPECT_EQ(to_string(job.options.method), method);
        const IterativeSimplificationOptions& options = job.options.iterative;
        EXPECT_EQ(options.k, 12U);
        EXPECT_EQ(options.placement, Placement::EndPoint);
        EXPECT_EQ(options.max_displacement, 0.5);
        EXPECT_EQ(options.color_weight, 0.25);
        EXPECT_EQ(options.attribute_weights.at("intensity"), 2);
    }
    EXPECT_EQ(simplify_job(R"("points": 9, "oversampling": 8)").options.oversampling, 8);
}

TEST(JobRequest, TakesTheOptionsOfIncremental) {
    const SimplifyJob job = simplify_job(
        R"("method": "incremental", "points": 9, "max_variation": 0.1,
           "representative": "centroid")");
    EXPECT_EQ(job.options.incremental.max_variation, 0.1);
    EXPECT_EQ(job.options.incremental.representative, Representative::Centroid);
    EXPECT_EQ(simplify_job(R"("method": "incremental", "max_cluster_size": 7)")
                  .options.incremental.max_cluster_size,
              7U);
}

TEST(JobRequest, TakesTheOptionsAndRegionsOfParticles) {
    const SimplifyJob job = simplify_job(
        R"("method": "particles", "points": 9, "adaptivity": 0.5, "max_grading": 3,
           "max_iterations": 7, "tolerance": 0.1,
           "regions": [{"sphere": {"center": [1, 2, 3], "radius": 4}, "density": 5},
                       {"box": {"min": [0, 0, 0], "max": [1, 2, 3]}, "density": 0.5},
                       {"attribute": {"name": "w", "low": -1, "high": 1}, "density": 2,
                        "transition": 0.25}])");
    const ParticleSimulationOptions& options = job.options.particles;
    EXPECT_EQ(options.adaptivity, 0.5);
    EXPECT_EQ(options.max_grading, 3);
    EXPECT_EQ(options.max_iterations, 7U);
    EXPECT_EQ(options.tolerance, 0.1);
    ASSERT_EQ(options.regions.size(), 3U);
    const auto& sphere = std::get<DensityRegion::Sphere>(options.regions[0].where);
    EXPECT_EQ(sphere.center, Vec3d(1, 2, 3));
    EXPECT_EQ(sphere.radius, 4);
    EXPECT_EQ(options.regions[0].density, 5);
    EXPECT_EQ(std::get<DensityRegion::Box>(options.regions[1].where).max, Vec3d(1, 2, 3));
    EXPECT_EQ(std::get<DensityRegion::Scalar>(options.regions[2].where).attribute, "w");
    EXPECT_EQ(options.regions[2].transition, 0.25);
}

TEST(JobRequest, TakesTheOptionsOfVoxel) {
    const SimplifyJob job = simplify_job(R"("method": "voxel", "voxel_size": 0.5)");
    EXPECT_EQ(job.options.voxel.voxel_size, 0.5);
}

TEST(JobRequest, TakesEveryFieldOfAnUpsampleJob) {
    const JobRequest request = job_request_from_json(request_with(
        "upsample", R"("ratio": 4, "adaptivity": 1, "seed": 3, "reductions": {"w": "max"},
                       "splats": "none", "format": "drc")"));
    EXPECT_EQ(type_name(request), "upsample");
    const auto& job = std::get<UpsampleJob>(request.job);
    EXPECT_EQ(job.options.ratio, 4);
    EXPECT_EQ(job.options.particles.adaptivity, 1);
    EXPECT_EQ(job.options.particles.seed, 3U);
    EXPECT_EQ(job.options.particles.reductions.at("w"), Reduction::Max);
    EXPECT_EQ(job.added.splats, SplatAttributes::None);
    EXPECT_EQ(job.output.formats, std::vector{CloudFormat::Draco});
}

TEST(JobRequest, TakesEveryFieldOfAnAnalyzeJob) {
    const JobRequest request = job_request_from_json(request_with(
        "analyze", R"("k": 24, "orient": "viewpoint", "viewpoint": [1, 2, 3], "format": "drc",
                      "feature_lines": {"variation": 0.1, "high": 0.9, "low": 0.5,
                                        "min_links": 7})"));
    EXPECT_EQ(type_name(request), "analyze");
    const auto& job = std::get<AnalyzeJob>(request.job);
    EXPECT_EQ(job.options.k, 24U);
    EXPECT_EQ(job.options.signs, NormalSigns::Viewpoint);
    EXPECT_EQ(job.options.viewpoint, Vec3d(1, 2, 3));
    ASSERT_TRUE(job.options.feature_lines);
    EXPECT_EQ(job.options.feature_lines->variation, 0.1);
    EXPECT_EQ(job.options.feature_lines->high, 0.9);
    EXPECT_EQ(job.options.feature_lines->low, 0.5);
    EXPECT_EQ(job.options.feature_lines->min_links, 7U);
}

TEST(JobRequest, TakesEveryFieldOfAPyramidJob) {
    const JobRequest request = job_request_from_json(pyramid_with(
        R"("levels": [1000, 1e4], "representative": "centroid", "formats": ["ply"],
           "draco": {"precision": 0.5})"));
    EXPECT_EQ(type_name(request), "pyramid");
    const auto& job = std::get<PyramidJob>(request.job);
    EXPECT_EQ(job.options.sizes, (std::vector<std::uint64_t>{1000, 10000}));
    EXPECT_EQ(job.options.simplification.method, Method::Hierarchical);
    EXPECT_EQ(job.options.simplification.hierarchical.representative, Representative::Centroid);
    EXPECT_EQ(job.output.formats, std::vector{CloudFormat::Ply});
    EXPECT_EQ(job.output.draco.precision, 0.5);
}

TEST(JobRequest, OfAPyramidTakesEveryMethodWithItsOwnOptions) {
    const JobRequest request = job_request_from_json(pyramid_with(R"("method": "iterative")"));
    EXPECT_EQ(std::get<PyramidJob>(request.job).options.simplification.method, Method::Iterative);
    for (const Method method : kMethods)
        EXPECT_EQ(refusal(pyramid_with("\"method\": \"" + std::string(to_string(method)) + '"')),
                  "");
    const JobRequest particles = job_request_from_json(
        pyramid_with(R"("method": "particles", "adaptivity": 0.5, "seed": 7)"));
    const auto& options = std::get<PyramidJob>(particles.job).options.simplification;
    EXPECT_EQ(options.particles.adaptivity, 0.5);
    EXPECT_EQ(options.seed, 7U);
    EXPECT_EQ(to_json(job_request_from_json(to_json(particles))), to_json(particles));
    EXPECT_NE(refusal(pyramid_with(R"("method": "voxel", "voxel_size": 0.5)")), "");
    EXPECT_EQ(refusal(pyramid_with(R"("method": "iterative", "representative": "surface")")),
              "representative: belongs to hierarchical, incremental and voxel, not to iterative");
}

TEST(JobRequest, HasTheDefaultsOfCore) {
    const auto simplify =
        std::get<SimplifyJob>(job_request_from_json(simplify_with(R"("ratio": 0.01)")).job);
    EXPECT_EQ(simplify.options.method, SimplifyOptions{}.method);
    EXPECT_EQ(simplify.output.formats, std::vector{CloudFormat::Ply});
    EXPECT_EQ(simplify.output.draco.position_bits, DracoEncodeOptions{}.position_bits);

    const auto pyramid = std::get<PyramidJob>(job_request_from_json(pyramid_with("")).job);
    EXPECT_EQ(pyramid.options.ratio, LodPyramidOptions{}.ratio);
    EXPECT_EQ(pyramid.output.formats,
              (std::vector{CloudFormat::Draco, CloudFormat::Ply, CloudFormat::Glb}));
    EXPECT_EQ(pyramid.tiles.max_points, LodTileOptions{}.max_points);
    EXPECT_FALSE(pyramid.transform);
}

TEST(JobRequest, AStreamIsMadeWhereItIsAskedForByEitherName) {
    const auto formats = [](const std::string& names) {
        return std::get<PyramidJob>(
                   job_request_from_json(pyramid_with(R"("formats": [)" + names + "]")).job)
            .output.formats;
    };
    EXPECT_EQ(formats(R"("stream")"), std::vector{CloudFormat::Progressive});
    EXPECT_EQ(formats(R"("drc", "stpc")"),
              (std::vector{CloudFormat::Draco, CloudFormat::Progressive}));
    EXPECT_EQ(formats(R"("copc", "glb")"), (std::vector{CloudFormat::Copc, CloudFormat::Glb}));
    const auto precise = std::get<PyramidJob>(
        job_request_from_json(pyramid_with(R"("formats": ["stpc"], "tiles": {"precision": 0.5})"))
            .job);
    EXPECT_EQ(precise.tiles.precision, 0.5);
    job_request_from_json(pyramid_with(R"("formats": ["ply"], "tiles": {})"));
}

TEST(JobRequest, ThatIsRefusedNamesFieldAndValueAndWhatIsExpected) {
    const std::pair<std::string, std::string> cases[] = {
        {simplify_with(R"("points": -3)"), "points: -3: expected an integer of at least 1"},
        {simplify_with(R"("points": 0)"), "points: 0: expected an integer of at least 1"},
        {simplify_with(R"("points": 2.5)"), "points: 2.5: expected an integer of at least 1"},
        {simplify_with(R"("points": "5")"), "points: \"5\": expected an integer of at least 1"},
        {simplify_with(R"("points": null)"), "points: null: expected an integer of at least 1"},
        {simplify_with(R"("points": 5, "k": -1)"), "k: -1: expected a whole number"},
        {simplify_with(R"("points": 5, "k": 5000000000)"),
         "k: 5000000000: expected at most 4294967295"},
        {R"({"type": "melt", "reference": "a"})",
         "type: \"melt\": expected simplify, pyramid, upsample, analyze, curve or evaluate"},
        {simplify_with(R"("points": 5, "a\u0000b": 1)"),
         R"(JSON: "a\u0000b": expected text without NUL)"},
        {simplify_with(R"("points": 5, "method": "a\u0000b")"),
         R"(JSON: "a\u0000b": expected text without NUL)"},
        {simplify_with(R"("points": 5, "draco": {"coding": "kd-tree", "position_bits": 0})"),
         "draco.coding: kd-tree holds no unquantised positions: expected sequential, or other "
         "position_bits than 0"},
        {simplify_with(R"("ratio": [1])"), "ratio: a list of 1: expected a number"},
        {simplify_with(R"("points": 5, "method": "voxel", "representative": "mean")"),
         "representative: \"mean\": expected one of surface, centroid, nearest"},
        {simplify_with(R"("points": 5, "reductions": {"w": "sum"})"),
         "reductions.w: \"sum\": expected one of mean, nearest, min, max, mode"},
        {simplify_with(R"("points": 5, "draco": {"position_bits": 31})"),
         "draco.position_bits: 31: expected an integer of 0 to 30"},
        {simplify_with(R"("points": 5, "draco": {"precision": 0})"),
         "draco.precision: 0: expected a length above 0, in input units"},
        {simplify_with(R"("points": 5, "draco": {"precision": 1, "position_bits": 8})"),
         "draco.precision: excludes position_bits: give one of the two"},
        {simplify_with(R"("points": 5, "draco": {"bits": 8})"),
         "draco.bits: unknown field: expected one of attribute_bits, coding, compression_level, "
         "normal_bits, position_bits, precision"},
        {pyramid_with(R"("levels": [10, "x"])"),
         "levels[1]: \"x\": expected an integer of at least 1"},
        {pyramid_with(R"("levels": [])"), "levels: a list of 0: expected at least one size"},
        {pyramid_with(R"("levels": [10], "ratio": 4)"),
         "levels: excludes ratio and base_points: give one form"},
        {pyramid_with(R"("base_points": 10, "base_bytes": 9000)"),
         "base_bytes: excludes base_points: give one of the two"},
        {pyramid_with(R"("base_bytes": 9000, "formats": ["ply"])"),
         "base_bytes: is the size of a glb: expected glb among the formats"},
        {pyramid_with(R"("refine": "more")"), "refine: \"more\": expected one of replace, add"},
        {pyramid_with(R"("refine": "add", "method": "hierarchical")"),
         "method hierarchical: expected iterative for nested levels"},
        {pyramid_with(R"("formats": [])"), "formats: a list of 0: expected at least one format"},
        {pyramid_with(R"("tiles": {"position_bits": 1})"),
         "tiles.position_bits: 1: expected an integer of 2 to 24"},
        {pyramid_with(R"("tiles": {"transform": [1, 0]})"),
         "tiles.transform: a list of 2: expected 16 numbers, column by column"},
        {pyramid_with(R"("tiles": {"transform": [1,0,0,0,0,1,0,0,0,0,1,0,1e300,0,0,1]})"),
         "tiles.transform: a list of 16: expected finite numbers of at most 1e100"},
        {pyramid_with(R"("tiles": {"transform": [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,0]})"),
         "tiles.transform: a list of 16: expected 0, 0, 0 and 1 as the last number of its columns"},
        {pyramid_with(R"("tiles": {"transform": [1,0,0,0,0,1,0,0,0,0,0,0,0,0,0,1]})"),
         "tiles.transform: a list of 16: expected a transform that keeps three dimensions"},
        {pyramid_with(R"("tiles": {"epsg": 4326})"),
         "tiles.epsg: 4326: expected 4978, 3857, 32601..32660, 32701..32760, 25828..25838 or "
         "26901..26923"},
        {pyramid_with(
             R"("tiles": {"epsg": 32633, "transform": [1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]})"),
         "tiles.epsg: excludes transform: give one of the two"},
        {pyramid_with(R"("formats": ["ply"], "tiles": {"max_points": 9})"),
         "tiles: an object: expected none without glb, stpc or copc.laz among the formats"},
        {simplify_with(R"("ratio": 0.5, "format": "glb")"), "format: \"glb\": expected ply or drc"},
        {simplify_with(R"("ratio": 0.5, "format": "stpc")"),
         "format: \"stpc\": expected ply or drc"},
        {pyramid_with(R"("formats": ["ply", "ply"])"),
         "formats[1]: \"ply\": expected each format once"},
        {R"({"input": ")" + kInput + "\"}", "type: missing: this field is required"},
        {R"({"type": "simplify", "input": "abc", "points": 1})",
         "input: \"abc\": expected the id of a cloud: 64 lower-case hexadecimal digits"},
        {request_with("magic", ""),
         "type: \"magic\": expected simplify, pyramid, upsample, analyze, curve or evaluate"},
        {simplify_with(R"("points": 5, "k": 40)"), "k 40: expected 3..32"},
        {simplify_with(R"("points": 5, "oversampling": 0.5)"),
         "oversampling 0.5: expected 1 to 1000"},
        {simplify_with(R"("points": 5, "placement": "middle")"),
         "placement: \"middle\": expected one of optimal, end-point"},
        {simplify_with(R"("points": 5, "splats": "disc")"),
         "splats: \"disc\": expected one of none, radius, normal, ellipse"},
        {simplify_with(R"("method": "particles", "points": 5, "regions": [{"density": 2}])"),
         "regions[0]: expected exactly one of sphere, box and attribute"},
        {simplify_with(R"("method": "particles", "points": 5, "regions": [
             {"sphere": {"center": [0, 0], "radius": 1}, "density": 2}])"),
         "regions[0].sphere.center: a list of 2: expected three numbers"},
        {simplify_with(R"("method": "particles", "points": 5, "regions": [
             {"sphere": {"center": [0, 0, 0], "radius": 1}, "density": 0}])"),
         "regions[0]: density 0: expected 1e-06..1e+06"},
        {request_with("upsample", R"("ratio": 0.5)"),
         "ratio 0.5: expected a finite number above 1"},
        {request_with("upsample", ""), "target: expected exactly one of points and ratio"},
        {request_with("analyze", R"("k": 2)"), "k 2: expected 3..64, or 0 to choose"},
        {request_with("analyze", R"("feature_lines": {"low": 0.9})"),
         "feature_lines: expected 0 < low <= high <= 1"},
        {request_with("analyze", R"("feature_lines": true)"),
         "feature_lines: true: expected an object"},
        {request_with("analyze", R"("viewpoint": [0, 0, 0])"),
         "viewpoint: expected only if normals should point towards it"},
        {request_with("analyze", R"("orient": "viewpoint")"),
         "viewpoint: missing: expected x, y and z, which normals should point towards"},
        {"[]", "JSON: a list of 0: expected an object"},
        {"", "JSON: not well-formed at byte 1"},
        {R"({"type": "simplify")", "JSON: not well-formed at byte 20"},
        {simplify_with(R"("points": 1, "points": 2)"), "JSON: the field \"points\" is given twice"},
        {simplify_with(R"("ratio": 1e999)"), "JSON: a number is out of range"},
        {std::string(10'000, '['), "JSON: nested more than 8 deep"},
        {std::string((64 << 10) + 1, ' '), "JSON: 65537 bytes: expected at most 65536"},
        {simplify_with(R"("reductions": {)" + repeated(257, R"("a#": "mean")") + "}"),
         "reductions: 257 items: expected at most 256"},
        {simplify_with(R"("method": "particles", "regions": [)" + repeated(257, "{}") + "]"),
         "regions: 257 items: expected at most 256"},
    };
    for (const auto& [json, expected] : cases) EXPECT_EQ(refusal(json), expected);
}

TEST(JobRequest, ThatAsksForAnUnknownFieldIsRefusedByItsName) {
    EXPECT_EQ(refusal(simplify_with(R"("point": 5)")).substr(0, 41),
              "point: unknown field: expected one of att");
    // A field of the other type is as unknown.
    EXPECT_EQ(refusal(pyramid_with(R"("points": 1)")).substr(0, 22), "points: unknown field:");
}

TEST(JobRequest, ThatHasAFieldOfAnotherMethodIsToldWhose) {
    EXPECT_EQ(refusal(simplify_with(R"("points": 5, "method": "voxel", "k": 8)")),
              "k: belongs to multiphase and iterative, not to voxel");
    EXPECT_EQ(refusal(simplify_with(R"("max_cluster_size": 50)")),
              "max_cluster_size: belongs to hierarchical and incremental, not to multiphase");
    EXPECT_EQ(refusal(simplify_with(R"("points": 5, "method": "random", "reductions": {})")),
              "reductions: belongs to multiphase, hierarchical, incremental, iterative, particles "
              "and voxel, not to random");
    EXPECT_EQ(refusal(request_with("upsample", R"("ratio": 2, "k": 8)")).substr(0, 17),
              "k: unknown field:");
}

TEST(JobRequest, OfEveryMethodHasItsFieldsAndNoOthers) {
    for (const Method method : kMethods) {
        const std::string name =
            std::string(R"("points": 5, "method": ")") + std::string(to_string(method)) + '"';
        const auto canonical =
            nlohmann::json::parse(to_json(JobRequest{kInput, simplify_job(name)}));
        for (const MethodField& field : method_fields()) {
            const bool optional = field.name == "max_displacement" || field.name == "voxel_size" ||
                                  field.name.starts_with("max_cluster") ||
                                  field.name == "max_variation";
            if (optional && field.has(method)) continue;
            EXPECT_EQ(canonical.contains(field.name), field.has(method))
                << to_string(method) << ' ' << field.name;
        }
    }
}

TEST(JobRequest, IsCheckedByCoreToo) {
    EXPECT_NE(refusal(simplify_with("")), "");                              // no target
    EXPECT_NE(refusal(simplify_with(R"("points": 5, "ratio": 0.5)")), "");  // two targets
    EXPECT_NE(refusal(simplify_with(R"("ratio": 1.5)")), "");
    EXPECT_NE(refusal(pyramid_with(R"("levels": [20, 10])")), "");
    EXPECT_NE(refusal(pyramid_with(R"("ratio": 1)")), "");
}

TEST(JobRequest, OfEveryTypeButEvaluateCanRemoveOutliers) {
    const auto outliers = [](const std::string& type, const std::string& more) {
        const JobRequest request = job_request_from_json(
            R"({"type": ")" + type + R"(", "input": ")" + std::string(64, 'a') + '"' + more + '}');
        EXPECT_EQ(to_json(job_request_from_json(to_json(request))), to_json(request));
        return std::visit(
            [](const auto& job) -> std::optional<double> {
                if constexpr (requires { job.outliers; })
                    if (job.outliers) return job.outliers->deviations;
                return std::nullopt;
            },
            request.job);
    };
    for (const auto& [type, target] :
         std::vector<std::pair<std::string, std::string>>{{"simplify", R"(, "points": 5)"},
                                                          {"upsample", R"(, "ratio": 2)"},
                                                          {"pyramid", ""},
                                                          {"analyze", ""},
                                                          {"curve", ""}}) {
        EXPECT_EQ(outliers(type, target), std::nullopt) << type;
        EXPECT_EQ(outliers(type, target + R"(, "remove_outliers": 3.5)"), 3.5) << type;
    }
    EXPECT_NE(refusal(simplify_with(R"("points": 5, "remove_outliers": 0.5)"))
                  .find("remove_outliers 0.5: expected 1..100 standard deviations"),
              std::string::npos);
    EXPECT_NE(refusal(simplify_with(R"("points": 5, "remove_outliers": true)")), "");
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

TEST(JobRequest, OfParticlesTravelsAsTheGoldenFileSays) {
    const std::string canonical = to_json(test::particles_request());
    EXPECT_EQ(canonical, golden("particles_request.json"));
    EXPECT_EQ(to_json(job_request_from_json(canonical)), canonical);
}

TEST(JobRequest, ToUpsampleTravelsAsTheGoldenFileSays) {
    const std::string canonical = to_json(test::upsample_request());
    EXPECT_EQ(canonical, golden("upsample_request.json"));
    EXPECT_EQ(to_json(job_request_from_json(canonical)), canonical);
}

TEST(JobRequest, ToAnalyzeTravelsAsTheGoldenFileSays) {
    const std::string canonical = to_json(test::analyze_request());
    EXPECT_EQ(canonical, golden("analyze_request.json"));
    EXPECT_EQ(to_json(job_request_from_json(canonical)), canonical);
}

TEST(JobRequest, ToEvaluateTravelsAsTheGoldenFileSays) {
    const std::string canonical = to_json(test::evaluate_request());
    EXPECT_EQ(canonical, golden("evaluate_request.json"));
    EXPECT_EQ(to_json(job_request_from_json(canonical)), canonical);
}

TEST(JobRequest, ToEvaluateTakesOneCandidateOrSeveral) {
    const std::string reference = R"({"reference": ")" + kInput + '"';
    const std::string b(64, 'b');
    const JobRequest one = evaluation_from_json(reference + R"(, "candidate": ")" + b + "\"}");
    EXPECT_EQ(std::get<EvaluateJob>(one.job).candidates, std::vector{b});
    EXPECT_EQ(inputs_of(one), (std::vector{kInput, b}));
    const JobRequest same =
        evaluation_from_json(reference + R"(, "type": "evaluate", "candidates": [")" + b + "\"]}");
    EXPECT_EQ(to_json(same), to_json(one));
}

TEST(JobRequest, ToEvaluateIsRefusedByNameAndValue) {
    const auto refused = [](const std::string& fields) {
        return test::refusal(evaluation_from_json,
                             R"({"reference": ")" + kInput + R"(", )" + fields + "}",
                             ErrorCode::InvalidArgument);
    };
    const std::string candidate = R"("candidate": ")" + kInput + "\"";
    EXPECT_EQ(refused(R"("seed": 1)"),
              "candidates: expected either candidates or candidate, for a single one");
    EXPECT_EQ(refused(R"("candidates": [])"), "candidates: 0 of them: expected 1 to 16");
    EXPECT_EQ(refused(R"("candidate": "x")"),
              "candidates: expected ids of clouds: 64 lower-case hexadecimal digits");
    EXPECT_EQ(refused(candidate + R"(, "k": 5)"), "k 5: expected 6..64");
    EXPECT_EQ(refused(candidate + R"(, "range": 0)"),
              "range 0.0: expected a distance above 0, in input units");
    EXPECT_EQ(refused(candidate + R"(, "views": ["inside"])"),
              "views: \"inside\": expected front, right, back, left, top or bottom");
    EXPECT_EQ(refused(candidate + R"(, "labels": ["a", "b"])"),
              "labels: a list of 2: expected one for each candidate");
    EXPECT_NE(refused(candidate + R"(, "basis": "cubic")").find("linear, quadratic, samples"),
              std::string::npos);
    EXPECT_NE(refused(candidate + R"(, "points": 5)").find("points"), std::string::npos);
}

TEST(JobRequest, OfAPyramidHasOneFormForEqualRequests) {
    const std::string canonical = to_json(test::pyramid_request());
    EXPECT_EQ(canonical, golden("pyramid_request.json"));
    EXPECT_EQ(to_json(job_request_from_json(pyramid_with(""))), canonical);
    EXPECT_EQ(to_json(job_request_from_json(pyramid_with(R"("formats": ["glb", "ply", "drc"])"))),
              canonical);
    EXPECT_NE(to_json(job_request_from_json(pyramid_with(R"("formats": ["ply"])"))), canonical);
    EXPECT_NE(to_json(job_request_from_json(pyramid_with(R"("levels": [5])"))), canonical);
}

TEST(JobRequest, TakesTheDefaultsOfOtherMethods) {
    const char* const defaults =
        R"("oversampling": 3, "k": 6.0, "placement": "optimal", "color_weight": 0,
           "attribute_weights": {}, "representative": "nearest", "adaptivity": 0, "max_grading": 4,
           "max_iterations": 40, "tolerance": 0.01, "regions": [])";
    for (const char* const method :
         {"multiphase", "hierarchical", "particles", "voxel", "random"}) {
        const std::string chosen = R"("method": ")" + std::string(method) + R"(")";
        EXPECT_EQ(
            to_json(job_request_from_json(simplify_with(chosen + ", \"points\": 5, " + defaults))),
            to_json(job_request_from_json(simplify_with(chosen + ", \"points\": 5"))));
    }
    EXPECT_EQ(refusal(simplify_with(R"("method": "voxel", "points": 5, "k": 7)")),
              "k: belongs to multiphase and iterative, not to voxel");
}

}  // namespace
}  // namespace stipple::proto
