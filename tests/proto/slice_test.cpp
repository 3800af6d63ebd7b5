#include "stipple/proto/slice.hpp"

#include "slice_pyramid.hpp"
#include "stipple/proto/pyramid_export.hpp"
#include "stipple/proto/tiles.hpp"
#include "stipple/surface_error.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cstddef>
#include <ranges>
#include <set>

namespace stipple::proto {
namespace {

TEST(Slice, HasExactlyThePointsAskedFor) {
    for (const std::uint64_t points : {1U, 199U, 200U, 201U, 999U, 3000U, 8000U}) {
        const Slice slice = both().slice({.points = points});
        EXPECT_EQ(slice.points, points);
        EXPECT_EQ(cloud_of(slice).size(), points);
    }
    EXPECT_EQ(both().slice({.points = 9000}).points, 8000U);
}

TEST(Slice, IsTheLevelItselfWhereTheCountsAgree) {
    const Slice slice = both().slice({.points = 1000});
    EXPECT_EQ(slice.level, 1U);
    EXPECT_EQ(slice.bytes, both().files.at(both().results.levels[1].files[0].sha256));
    EXPECT_EQ(slice.error_mean, both().results.levels[1].error->error.mean());
}

TEST(Slice, KeepsEveryAttribute) {
    const PointCloud cloud = cloud_of(both().slice({.points = 700}));
    EXPECT_EQ(cloud.normals.size(), 700U);
    EXPECT_EQ(cloud.colors.size(), 700U);
    ASSERT_EQ(cloud.attributes.size(), source().attributes.size());
    for (std::size_t i = 0; i < cloud.attributes.size(); ++i)
        EXPECT_EQ(cloud.attributes[i].name, source().attributes[i].name);
}

TEST(Slice, FromTilesStandsInTheFrameOfTheSource) {
    PointCloud cloud = test::sphere(3'000);
    for (Vec3f& p : cloud.positions) p += Vec3f(0.3F, 0.2F, 0.1F);
    const Aabb box{Vec3d(0, 0, 0), Vec3d(2, 2, 2)};
    for (const Vec3d& origin : {Vec3d(0, 0, 0), Vec3d(5e5, 5e6, 100)}) {
        cloud.origin = origin;
        const Pyramid pyramid(cloud, {500, 3'000}, {CloudFormat::Glb});
        for (const CloudFormat format : {CloudFormat::Ply, CloudFormat::Draco}) {
            const Aabb there{box.min + origin, box.max + origin};
            const Slice slice = pyramid.slice({.points = 400, .box = there, .format = format});
            EXPECT_EQ(slice.origin, origin);
            const PointCloud cut = cloud_of(slice);
            EXPECT_LT((bounds(cut).max - origin - Vec3d(1.3, 1.2, 1.1)).norm(), 0.3);
            if (!origin.isZero(0)) continue;
            EXPECT_EQ(cut.origin, origin);
            EXPECT_FALSE(cut.double_precision);
        }
    }
}

TEST(Slice, TakesTheCoarsestLevelWithinAnError) {
    const auto& levels = both().results.levels;
    for (const std::size_t i : {0U, 1U, 2U}) {
        const double max = levels[i].error->error.max();
        const Slice slice = both().slice({.max_error = max * 1.0001});
        EXPECT_EQ(slice.level, i);
        EXPECT_EQ(slice.points, levels[i].points);
        EXPECT_EQ(slice.error_max, max);
    }
    EXPECT_EQ(both().slice({.max_error = 1e-9}).points, 8000U);
}

TEST(Slice, TakesTheCoarsestLevelWithinAnErrorThatHasAPointInTheBox) {
    const Vec3d place = source().positions[4'321].cast<double>();
    const Aabb around{place - Vec3d::Constant(1e-3), place + Vec3d::Constant(1e-3)};
    const Pyramid tiles(source(), {200, 8'000}, {CloudFormat::Glb});
    for (const Pyramid* pyramid : {&both(), &tiles}) {
        const Slice slice = pyramid->slice({.max_error = 1.0, .box = around});
        EXPECT_EQ(slice.points, 1U);
        EXPECT_LT((bounds(cloud_of(slice)).min - place).norm(), 1e-3);
    }
    const Vec3d inner = 0.5 * place;
    EXPECT_EQ(refusal(both(), {.max_error = 1.0, .box = Aabb{inner, inner}}), ErrorCode::NotFound);
}

TEST(Slice, WithinAnErrorCountsThePointsOfItsBoxNotOfItsTiles) {
    const PointCloud cloud = test::sphere(8'000);
    const Pyramid tiles(cloud, {8'000}, {CloudFormat::Glb});
    const Vec3d place = cloud.positions[17].cast<double>();
    const Aabb around{place - Vec3d::Constant(0.05), place + Vec3d::Constant(0.05)};
    const Slice slice = tiles.slice({.max_error = 1.0, .box = around, .max_points = 1'000});
    EXPECT_GT(slice.points, 0U);
    EXPECT_LT(slice.points, 100U);
    EXPECT_EQ(refusal(tiles, {.max_error = 1.0, .max_points = 1'000}), ErrorCode::TooLarge);
}

TEST(Slice, TakesAnErrorAsAPartOfTheDiagonal) {
    const double diagonal = both().results.source->bounds.diagonal();
    const double error = both().results.levels[2].error->error.max() + 1e-9;
    EXPECT_EQ(both().slice({.max_error_rel = error / diagonal}).level,
              both().slice({.max_error = error}).level);
    EXPECT_EQ(refusal(both(), {.max_error = 1.0, .max_error_rel = 0.1}),
              ErrorCode::InvalidArgument);
}

TEST(Slice, TakesTheErrorOfTilesWhereThatOfLevelsWasNotMeasured) {
    Pyramid pyramid = both();
    for (OutputCloud& level : pyramid.results.levels) level.error.reset();
    const Slice slice = pyramid.slice({.max_error = 0.05});
    EXPECT_LE(slice.error_max.value(), 0.05);
    EXPECT_EQ(refusal(pyramid, {.max_error = 0.05, .box = Aabb{Vec3d(5, 5, 5), Vec3d(6, 6, 6)}}),
              ErrorCode::NotFound);
}

TEST(Slice, OfABoxAroundNoiseTellsNoMoreThanTheErrorOfItsLevelAndTheRounding) {
    const PointCloud noise =
        test::cube(4'000);  // far from its own surface, where tiles look for it
    const Pyramid pyramid(noise, {500, 4'000}, {CloudFormat::Ply, CloudFormat::Glb});
    const OutputCloud& finest = pyramid.results.levels.back();
    const double step = finest.files.back().tile->step;
    ASSERT_GT(finest.decoded->error.max, 2 * step);
    const Aabb all = finest.bounds;
    const Slice slice = pyramid.slice({.max_error = step, .box = all});
    EXPECT_EQ(slice.points, 4'000U);
    EXPECT_LE(slice.error_max.value(), step);
    const PointCloud cut = cloud_of(slice);
    for (std::size_t i = 0; i < noise.size(); i += 40) {
        const auto to = [&](const Vec3f& p) { return (p - noise.positions[i]).norm(); };
        EXPECT_LE(std::ranges::min(cut.positions | std::views::transform(to)),
                  slice.error_max.value());
    }
}

TEST(Slice, TellsAnErrorThatIsNoLessThanItsOwn) {
    const Slice slice = both().slice({.points = 600});
    const SurfaceError own = measure_error(source(), cloud_of(slice), {});
    EXPECT_GE(slice.error_mean.value(), 0.8 * own.mean());
    EXPECT_LE(slice.error_mean.value(), 3 * own.mean());
    EXPECT_GE(slice.error_max.value(), 0.7 * own.max());
}

TEST(Slice, FillsItsBytes) {
    for (const CloudFormat format : {CloudFormat::Ply, CloudFormat::Draco, CloudFormat::Glb}) {
        const Slice slice = both().slice({.bytes = 20'000, .format = format});
        EXPECT_LE(slice.bytes.size(), 20'000U);
        EXPECT_GE(slice.bytes.size(), 19'000U) << to_string(format);
        const Slice all = both().slice({.bytes = 100'000'000, .format = format});
        EXPECT_EQ(all.points, 8000U);
    }
    EXPECT_EQ(refusal(both(), {.bytes = 20}), ErrorCode::InvalidArgument);
}

TEST(Slice, FillsFewBytesOfWhichTheHeaderTakesMost) {
    for (const CloudFormat format : {CloudFormat::Ply, CloudFormat::Draco, CloudFormat::Glb}) {
        const std::uint64_t one = both().slice({.points = 1, .format = format}).bytes.size();
        EXPECT_EQ(refusal(both(), {.bytes = one - 1, .format = format}),
                  ErrorCode::InvalidArgument);
        for (const std::uint64_t more : {0U, 1U, 60U, 300U}) {
            const Slice slice = both().slice({.bytes = one + more, .format = format});
            EXPECT_LE(slice.bytes.size(), one + more);
            if (slice.points < 8'000) {
                EXPECT_GT(both().slice({.points = slice.points + 2, .format = format}).bytes.size(),
                          0.98 * static_cast<double>(one + more))
                    << to_string(format) << ' ' << more;
            }
        }
    }
}

TEST(Slice, IsOneTileInTheCoordinatesOfTheFileAsGlb) {
    PointCloud far = test::sphere(3000);
    far.origin = Vec3d(500'000, 5'000'000, 100);
    const Pyramid pyramid(far, {500, 3000}, {CloudFormat::Ply});
    const LodTile tile =
        decode_glb(pyramid.slice({.points = 800, .format = CloudFormat::Glb}).bytes);
    const Aabb box = bounds(decode_tile(tile));
    EXPECT_LT((box.min - bounds(far).min).norm(), 0.2);
    EXPECT_LT((box.max - bounds(far).max).norm(), 0.2);
}

TEST(Slice, HasAllPointsAsGlbThoughTheyLieFarApart) {
    PointCloud cloud = test::sphere(2'000);
    for (std::size_t i = 0; i < cloud.size(); ++i)
        cloud.positions[i] = 1e-3F * cloud.positions[i] + Vec3f(i % 2 == 0 ? 0.0F : 20.0F, 0, 0);
    const Pyramid pyramid(cloud, {2'000}, {CloudFormat::Ply});
    const Slice slice = pyramid.slice({.points = 2'000, .format = CloudFormat::Glb});
    EXPECT_EQ(decode_tile(decode_glb(slice.bytes)).size(), slice.points);
}

TEST(Slice, CountsWhatItsFormatRounds) {
    DracoEncodeOptions coarse;
    coarse.position_bits = 6;
    const Slice slice =
        both().slice({.points = 8'000, .format = CloudFormat::Draco, .draco = coarse});
    const SurfaceError error = measure_error(source(), cloud_of(slice), {});
    EXPECT_GE(*slice.error_mean, error.forward.mean);
    EXPECT_GE(*slice.error_max, error.forward.max);
    EXPECT_EQ(refusal(both(), {.max_error = 1e-3, .format = CloudFormat::Draco, .draco = coarse}),
              ErrorCode::InvalidArgument);
}

TEST(Slice, TellsWhichErrorOfTheFinestLevelIsThatOfItsFormat) {
    const Pyramid rough(source(), {200}, {CloudFormat::Ply});
    const double max = rough.results.levels[0].error->error.max();
    const auto told = [&](double bound) {
        return refusal_text(rough, {.max_error = bound, .format = CloudFormat::Draco});
    };
    EXPECT_NE(told(max / 2).find("before this format rounds it"), std::string::npos);
    EXPECT_NE(told(max).find("of the finest level in this format"), std::string::npos);
}

TEST(Slice, OfExactFloatsHasTheErrorOfItsLevel) {
    const PointCloud far = [] {  // whose Draco file has no grid: it would have too many steps
        PointCloud cloud = test::sphere(8'000);
        cloud.positions.push_back({1e6F, 0, 0});
        return cloud;
    }();
    const Pyramid pyramid(far, {far.size()}, {CloudFormat::Ply});
    const Slice slice = pyramid.slice({.max_error = 1e-9, .format = CloudFormat::Draco});
    EXPECT_EQ(cloud_of(slice).size(), far.size());
    EXPECT_EQ(slice.error_max, 0.0);
}

TEST(Slice, OfOnePointHasNoErrorInAnyFormat) {
    PointCloud point;
    point.positions = {{1, 2, 3}};
    const Pyramid pyramid(point, {1}, {CloudFormat::Ply, CloudFormat::Glb});
    for (const CloudFormat format : {CloudFormat::Ply, CloudFormat::Draco, CloudFormat::Glb}) {
        const Slice slice = pyramid.slice({.max_error_rel = 0.005, .format = format});
        EXPECT_EQ(slice.points, 1U);
        EXPECT_EQ(slice.error_max, 0.0);
    }
}

TEST(Slice, IsCutFromTilesWhereThereIsNoPly) {
    const Pyramid tiles(source(), {200, 8000}, {CloudFormat::Glb});
    const PointCloud cloud = cloud_of(tiles.slice({.points = 5000}));
    EXPECT_EQ(cloud.size(), 5000U);
    EXPECT_EQ(cloud.normals.size(), 5000U);
    for (const Vec3f& p : cloud.positions) EXPECT_NEAR(p.norm(), 1, 0.05);
    const Pyramid draco(source(), {200, 8000}, {CloudFormat::Draco});
    EXPECT_EQ(refusal(draco, {.points = 100}), ErrorCode::InvalidArgument);
}

TEST(Slice, FromTilesBlendsNoLabelsAndHasTheOrderOfTheManifest) {
    PointCloud cloud = test::sphere(6000);
    const std::size_t n = cloud.size();
    std::vector<std::int32_t> labels;
    for (std::size_t i = 0; i < n; ++i) labels.push_back(i % 2 == 0 ? 7 : 1000);
    cloud.attributes = {{"zone", labels, 1, Reduction::Nearest},
                        {"heat", std::vector<float>(n, 0.5F)},
                        {"area", std::vector<std::uint8_t>(n, 3), 1, Reduction::Nearest}};
    const Pyramid pyramid(cloud, {3000, 6000}, {CloudFormat::Glb}, 1000, false, true);
    for (const std::uint64_t points : {std::uint64_t{2000}, std::uint64_t{3000}}) {
        const PointCloud slice = cloud_of(pyramid.slice({.points = points}));
        ASSERT_EQ(slice.attributes.size(), 3U);
        EXPECT_EQ(slice.attributes[0].name, "zone");
        EXPECT_EQ(slice.attributes[1].name, "heat");
        EXPECT_EQ(slice.attributes[2].name, "area");
        std::visit(
            [](const auto& values) {
                for (const auto v : values) EXPECT_TRUE(v == 7 || v == 1000) << v;
            },
            slice.attributes[0].values);
    }
}

TEST(Slice, OfAdditiveTilesTakesThoseOfCoarserLevelsToo) {
    const PointCloud cloud = test::sphere(10'000);
    const Pyramid pyramid(cloud, {600, 2'500, 10'000}, {CloudFormat::Glb}, 1'000, true);
    for (const std::size_t level : {0U, 1U, 2U}) {
        const std::uint64_t points = pyramid.results.levels[level].points;
        const Slice slice = pyramid.slice({.points = points});
        EXPECT_EQ(slice.level, level);
        EXPECT_EQ(decode_cloud(slice.bytes).size(), points);
        EXPECT_EQ(slice.error_mean, pyramid.results.levels[level].decoded->error.mean);
    }
    const Aabb box{{-2, -2, -2}, {2, 2, 0}};
    const Slice half = pyramid.slice({.points = 10'000, .box = box});
    EXPECT_NEAR(static_cast<double>(half.points), 5'000, 500);
    for (const Vec3f& p : decode_cloud(half.bytes).positions) EXPECT_LE(p.z(), 0.0F);
}

TEST(Slice, RefusalsTellTheValueAndTheLimitHoweverSmall) {
    Pyramid tiles = both();
    for (OutputCloud& level : tiles.results.levels) level.error.reset();
    const std::string error = refusal_text(tiles, {.max_error = 1e-9});
    EXPECT_TRUE(error.starts_with("max_error 1e-09: expected at least ")) << error;
    const std::string bytes = refusal_text(both(), {.bytes = 3});
    EXPECT_TRUE(bytes.starts_with("bytes 3: expected at least ")) << bytes;
    EXPECT_TRUE(bytes.ends_with(", for 1 point")) << bytes;
}

TEST(Slice, RefusesAPyramidOfOtherFormatsBeforeItAsksForAnotherBound) {
    Pyramid pyramid = both();
    for (OutputCloud& level : pyramid.results.levels)
        for (OutputFile& file : level.files) file = {CloudFormat::Draco, 1, "", ""};
    const std::string error = refusal_text(pyramid, {.max_error = 1e-9});
    EXPECT_TRUE(error.starts_with("this pyramid has neither PLY levels nor tiles")) << error;
}

TEST(Slice, RefusesWhatCannotBe) {
    EXPECT_EQ(refusal(both(), {}), ErrorCode::InvalidArgument);
    EXPECT_EQ(refusal(both(), {.points = 1, .bytes = 1}), ErrorCode::InvalidArgument);
    EXPECT_EQ(refusal(both(), {.points = 0}), ErrorCode::InvalidArgument);
    EXPECT_EQ(refusal(both(), {.max_error = -1.0}), ErrorCode::InvalidArgument);
    EXPECT_EQ(refusal(both(), {.points = 1, .format = CloudFormat::Progressive}),
              ErrorCode::InvalidArgument);
    EXPECT_EQ(refusal(both(), {.points = 1, .box = Aabb{Vec3d(1, 0, 0), Vec3d(0, 1, 1)}}),
              ErrorCode::InvalidArgument);
    EXPECT_EQ(refusal(both(), {.points = 1, .box = Aabb{Vec3d(5, 5, 5), Vec3d(6, 6, 6)}}),
              ErrorCode::NotFound);
    EXPECT_EQ(refusal(both(), {.bytes = 5'000, .box = Aabb{Vec3d(5, 5, 5), Vec3d(6, 6, 6)}}),
              ErrorCode::NotFound);
    EXPECT_EQ(refusal(both(), {.points = 3000, .max_points = 2000}), ErrorCode::TooLarge);
    EXPECT_EQ(refusal(both(), {.max_error = 1e-9, .max_points = 2000}), ErrorCode::TooLarge);
    EXPECT_EQ(refusal(both(), {.points = 3000, .max_read_bytes = 30'000}), ErrorCode::TooLarge);
    Pyramid contradicting = both();
    for (OutputCloud& level : contradicting.results.levels)
        for (OutputFile& file : level.files)
            if (file.format == CloudFormat::Ply)
                contradicting.files[file.sha256] = encode_draco(source());
    EXPECT_EQ(refusal(contradicting, {.points = 100}), ErrorCode::MalformedInput);
    for (auto& [name, bytes] : contradicting.files) bytes = encode_ply(test::sphere(150));
    EXPECT_EQ(refusal(contradicting, {.points = 100}), ErrorCode::MalformedInput);
    Pyramid unfinished = both();
    unfinished.results.complete = false;
    EXPECT_EQ(refusal(unfinished, {.points = 1}), ErrorCode::InvalidArgument);
}

TEST(Slice, HasAQueryThatSaysAllOfIt) {
    EXPECT_EQ(slice_query({.points = 5, .format = CloudFormat::Draco}), "format=drc&points=5");
    EXPECT_EQ(slice_query({.points = 5,
                           .format = CloudFormat::Draco,
                           .draco = {.coding = DracoCoding::KdTree, .precision = 0.25}}),
              "format=drc&points=5&coding=kd-tree&precision=0.25");
    EXPECT_EQ(slice_query({.max_error = 0.5, .box = Aabb{Vec3d(0, -1, 2.5), Vec3d(1, 1, 3)}}),
              "format=ply&max_error=0.5&box=0.0,-1.0,2.5,1.0,1.0,3.0");
    EXPECT_EQ(slice_query({.max_error_rel = 0.003}), "format=ply&max_error=0.3%25");
}

TEST(PyramidExport, NamesEachFileOnceRelativeAndTheManifestLast) {
    Results results = both().results;
    for (OutputCloud& level : results.levels)
        for (OutputFile& file : level.files) file.href = "/v1/pyramids/0/" + file.href;
    const auto files = export_files(results);
    std::set<std::string> names;
    for (const ExportFile& file : files) EXPECT_TRUE(names.insert(file.name).second) << file.name;
    EXPECT_TRUE(names.contains("level-2.ply"));
    EXPECT_TRUE(names.contains("tileset.json"));
    EXPECT_EQ(files.back().name, "manifest.json");
    const Results back = results_from_json(files.back().text);
    for (const OutputCloud& level : back.levels)
        for (const OutputFile& file : level.files) EXPECT_TRUE(names.contains(file.href));
    for (const ExportFile& file : files) EXPECT_EQ(file.text.find("/v1/"), std::string::npos);
}

}  // namespace
}  // namespace stipple::proto
