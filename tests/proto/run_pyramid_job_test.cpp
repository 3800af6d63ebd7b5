#include "run_job_fixture.hpp"
#include "stipple/copc.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/tiles.hpp"

#include <cmath>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <tuple>

namespace stipple::proto {
namespace {

namespace fs = std::filesystem;

using RunPyramidJob = RunJob;

TEST_F(RunPyramidJob, WritesEveryLevelOfAPyramidInEveryFormatCoarsestFirst) {
    run(spec_for(test::sphere(3000), levels_of({50, 500, 3000})));
    const auto written = levels();
    ASSERT_EQ(written.size(), 3U);
    const std::uint64_t sizes[] = {50, 500, 3000};
    for (unsigned i = 0; i < 3; ++i) {
        EXPECT_EQ(written[i].level, i);
        EXPECT_EQ(written[i].points, sizes[i]);
        ASSERT_EQ(written[i].files.size(), 2U);
        for (const OutputFile& file : written[i].files) {
            EXPECT_EQ(read_cloud(folder_ / "out" / file.href).size(), sizes[i]);
        }
    }
    EXPECT_EQ(files_written(), 6U);  // nothing half-written is left
}

TEST_F(RunPyramidJob, WritesTheFinestLevelAsAStream) {
    PyramidJob job = levels_of({50, 2000});
    job.output.formats = {CloudFormat::Progressive};
    run(spec_for(test::sphere(3000), job));
    ASSERT_EQ(levels().size(), 2U);
    EXPECT_TRUE(levels()[0].files.empty());
    ASSERT_EQ(levels()[1].files.size(), 1U);
    const OutputFile file = levels()[1].files.front();
    EXPECT_EQ(file.format, CloudFormat::Progressive);
    EXPECT_EQ(file.href, "cloud.stpc");
    EXPECT_EQ(file.sha256, sha256_of_file(folder_ / "out" / file.href));
    EXPECT_EQ(read_cloud(folder_ / "out" / file.href).size(), 2000U);
}

TEST_F(RunPyramidJob, WritesTheFinestLevelAsAnOctree) {
    PyramidJob job = levels_of({50, 2000});
    job.output.formats = {CloudFormat::Ply, CloudFormat::Copc};
    job.tiles.precision = 0.005;
    run(spec_for(test::sphere(3000), job));
    EXPECT_EQ(levels()[0].files.size(), 1U);
    ASSERT_EQ(levels()[1].files.size(), 2U);
    const OutputFile file = levels()[1].files.back();
    EXPECT_EQ(file.format, CloudFormat::Copc);
    EXPECT_EQ(file.href, "cloud.copc.laz");
    EXPECT_EQ(file.sha256, sha256_of_file(folder_ / "out" / file.href));
    const std::vector<std::byte> expected = encode_copc(
        read_cloud(folder_ / "out" / levels()[1].files.front().href), {.precision = 0.005});
    EXPECT_EQ(file.sha256, sha256_hex(expected));
}

TEST_F(RunPyramidJob, TellsTheSpacingOfALevelAndThatOfItsRoundedTiles) {
    PyramidJob job = levels_of({500, 3000});
    job.tiles = {.position_bits = 5, .tolerance = 100};
    job.output.formats = {CloudFormat::Ply, CloudFormat::Glb};
    run(spec_for(test::sphere(3000), job));
    for (const OutputCloud& level : levels()) {
        const PointCloud exact = read_cloud(folder_ / "out" / level.files.front().href);
        const double spacing = mean_spacing(exact.positions);
        EXPECT_NEAR(level.spacing / spacing, 1, 0.01);
        EXPECT_GT(std::abs(level.decoded.value().spacing / spacing - 1), 0.03);
    }
}

TEST_F(RunPyramidJob, WritesTilesNamedByTheirHashes) {
    PyramidJob job = levels_of({50, 3000});
    job.output.formats = {CloudFormat::Glb};
    job.tiles.max_points = 1000;
    run(spec_for(test::sphere(3000), job));
    ASSERT_EQ(levels().size(), 2U);
    for (const OutputCloud& level : levels()) {
        std::uint64_t points = 0;
        EXPECT_EQ(level.files.size(), level.level == 0 ? 1U : 4U);
        for (const OutputFile& file : level.files) {
            EXPECT_EQ(file.href, sha256_of_file(folder_ / "out" / file.href) + ".glb");
            ASSERT_TRUE(file.tile);
            EXPECT_EQ(file.tile->parent.has_value(), level.level > 0);
            points += file.tile->points;
        }
        EXPECT_EQ(points, level.points);
    }
    EXPECT_EQ(files_written(), 5U);
}

TEST_F(RunPyramidJob, MeasuresTilesAtFewPlacesWhereNoErrorIsAskedFor) {
    PyramidJob job = levels_of({500});
    job.output.formats = {CloudFormat::Glb};
    const auto samples = [&](bool error, LodErrors errors) {
        job.error = error;
        job.tiles.errors = errors;
        reports_.clear();
        run(spec_for(test::sphere(3000), job));
        return levels().front().decoded->error.samples;
    };
    const std::uint64_t few = samples(false, LodErrors::Sure);
    EXPECT_LT(few, samples(true, LodErrors::Sure));
    EXPECT_EQ(samples(false, LodErrors::Exact), samples(true, LodErrors::Exact));
}

TEST_F(RunPyramidJob, BeginsAPyramidWithTheTileThatFits) {
    for (const Method method : {Method::Hierarchical, Method::Multiphase, Method::Particles}) {
        PyramidJob job;
        job.options.simplification.method = method;
        job.base_bytes = 6'000;
        job.output.formats = {CloudFormat::Glb};
        reports_.clear();
        run(spec_for(test::sphere(20'000, 0.01), job));
        const OutputCloud base = levels().front();
        ASSERT_EQ(base.files.size(), 1U);
        EXPECT_LE(base.files[0].bytes, 6'000U);
        EXPECT_GE(base.files[0].bytes, 5'000U);
        EXPECT_EQ(levels().back().points, 20'000U);
    }
}

TEST_F(RunPyramidJob, HasNoPyramidWhoseTileCannotFit) {
    PyramidJob job;
    job.base_bytes = 100;
    job.output.formats = {CloudFormat::Glb};
    EXPECT_THROW(run(spec_for(test::sphere(2'000), job)), Error);
}

TEST_F(RunPyramidJob, AddsPointsFromLevelToLevelWhereAsked) {
    PyramidJob job;
    job.options.simplification.method = Method::Iterative;
    job.options.nested = true;
    job.options.base_points = 500;
    job.output.formats = {CloudFormat::Glb, CloudFormat::Ply};
    run(spec_for(test::sphere(8'000, 0.01), job));
    std::uint64_t in_tiles = 0;
    for (const OutputCloud& level : levels()) {
        for (const OutputFile& file : level.files)
            if (file.tile) in_tiles += file.tile->points;
        EXPECT_EQ(in_tiles, level.points);
    }
    EXPECT_EQ(in_tiles, 8'000U);
}

struct Degenerate {
    const char* name;
    std::function<PointCloud()> make;
};

PointCloud at(std::vector<Vec3f> positions) {
    PointCloud cloud;
    cloud.positions = std::move(positions);
    return cloud;
}

PointCloud far_apart() {
    PointCloud cloud = test::cube(400);
    for (std::size_t i = 0; i < 400; i += 2) cloud.positions[i].x() += 1e5F;
    return cloud;
}

PointCloud with_points_nowhere() {
    PointCloud cloud = test::sphere(300);
    cloud.positions[7].x() = std::numeric_limits<float>::quiet_NaN();
    cloud.positions[8].y() = std::numeric_limits<float>::infinity();
    return cloud;
}

PointCloud shifted_far() {
    PointCloud cloud = test::sphere(300);
    cloud.origin = Vec3d(4.5e6, -5.5e6, 3e5);
    return cloud;
}

PointCloud colored_plane() {
    PointCloud cloud = test::plane(300);
    for (std::size_t i = 0; i < cloud.size(); ++i)
        cloud.colors.push_back({static_cast<std::uint8_t>(i % 256), 3, 200});
    return cloud;
}

/// Clouds of which most things are not defined, as pyramids of every method in every format.
class PyramidOfDegenerate : public RunJob,
                            public testing::WithParamInterface<std::tuple<Method, Degenerate>> {};

TEST_P(PyramidOfDegenerate, HasNoEmptyTileNoBoxOfNoSizeAndFiniteFigures) {
    const auto& [method, shape] = GetParam();
    PyramidJob job;
    job.options.simplification.method = method;
    job.options.base_points = 20;
    job.tiles.max_points = 64;
    job.output.formats = {CloudFormat::Glb, CloudFormat::Draco, CloudFormat::Ply};
    const PointCloud cloud = shape.make();
    const JobSpec spec = spec_for(cloud, job);
    run(spec);

    Results results{.request = spec.request, .source = source(), .levels = levels(), .cost = {}};
    ASSERT_FALSE(results.levels.empty());
    std::uint64_t finest = 0;
    for (const OutputCloud& level : results.levels) {
        ASSERT_TRUE(level.decoded);
        const LodFigures& figures = *level.decoded;
        for (const double figure : {figures.error.mean, figures.error.max, figures.error.p99,
                                    figures.spacing, figures.cover_radius})
            EXPECT_TRUE(std::isfinite(figure) && figure >= 0) << figure;
        EXPECT_GE(figures.error.samples, 1U);
        std::uint64_t in_tiles = 0;
        for (const OutputFile& file : level.files) {
            EXPECT_EQ(fs::file_size(folder_ / "out" / file.href), file.bytes);
            if (file.format != CloudFormat::Glb) {
                EXPECT_EQ(read_cloud(folder_ / "out" / file.href).size(), level.points);
                if (file.format == CloudFormat::Draco && level.error) {
                    ASSERT_TRUE(file.error);
                    EXPECT_GE(file.error->mean, level.error->error.mean());
                }
                continue;
            }
            EXPECT_GE(file.tile->points, 1U);
            EXPECT_LE(file.tile->points, job.tiles.max_points);
            in_tiles += file.tile->points;
        }
        EXPECT_EQ(in_tiles, level.points);
        EXPECT_GE(level.points, finest);
        finest = level.points;
    }
    EXPECT_EQ(finest,
              results.source->points - results.source->non_finite - results.source->duplicates);

    for (const TilesetFile& file : tileset_files(results)) {
        const auto root = nlohmann::json::parse(file.json)["root"];
        const auto& box = root["boundingVolume"]["box"];
        for (const int half : {3, 7, 11}) EXPECT_GT(box[half].get<double>(), 0);
        EXPECT_GT(root["geometricError"].get<double>(), 0);
    }
}

INSTANTIATE_TEST_SUITE_P(
    , PyramidOfDegenerate,
    testing::Combine(
        testing::ValuesIn(kMethods),
        testing::Values(Degenerate{"OnePoint",
                                   [] {
                                       return at({{5, 6, 7}});
                                   }},
                        Degenerate{"TwoPoints",
                                   [] {
                                       return at({{5, 6, 7}, {5, 6, 8}});
                                   }},
                        Degenerate{"AllEqual",
                                   [] { return at(std::vector<Vec3f>(500, Vec3f(5, 6, 7))); }},
                        Degenerate{"AHundredPoints", [] { return test::sphere(100); }},
                        Degenerate{"ALine", [] { return test::line(300); }},
                        Degenerate{"APlane", [] { return test::plane(300); }},
                        Degenerate{"TwoClustersFarApart", far_apart},
                        Degenerate{"FarFromTheOrigin", shifted_far},
                        Degenerate{"NotANumber", with_points_nowhere},
                        Degenerate{"OnlyColours", colored_plane})),
    [](const auto& test) {
        return std::string(to_string(std::get<0>(test.param))) + std::get<1>(test.param).name;
    });

}  // namespace
}  // namespace stipple::proto
