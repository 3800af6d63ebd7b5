#include "stipple/proto/slice.hpp"

#include "slice_pyramid.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <cstddef>

// Slices of a box.

namespace stipple::proto {
namespace {

TEST(Slice, KeepsWideNumbersInABoxWhereThereIsAPly) {
    PointCloud cloud = test::sphere(2000);
    std::vector<std::int32_t> numbers(cloud.size());
    std::vector<double> times(cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        numbers[i] = 2'000'000'000 + static_cast<std::int32_t>(i);
        times[i] = 1.6e9 + 0.25 * static_cast<double>(i);
    }
    cloud.attributes = {{"number", numbers, 1, Reduction::Nearest},
                        {"time", times, 1, Reduction::Nearest}};
    const Aabb all = bounds(cloud);
    for (const bool in_tiles : {true, false}) {
        const Pyramid pyramid(cloud, {500, 2000}, {CloudFormat::Ply, CloudFormat::Glb}, 1000, false,
                              in_tiles);
        const PointCloud cut = cloud_of(pyramid.slice({.points = 2000, .box = all}));
        ASSERT_EQ(cut.attributes.size(), in_tiles ? 2U : 0U);
        if (!in_tiles) continue;
        EXPECT_EQ(std::get<std::vector<std::int32_t>>(cut.attributes[0].values), numbers);
        EXPECT_EQ(std::get<std::vector<double>>(cut.attributes[1].values), times);
    }
}

TEST(Slice, ReadsOnlyTilesThatMeetTheBox) {
    const Slice slice = both().slice({.points = 500, .box = kEighth});
    EXPECT_EQ(slice.points, 500U);
    EXPECT_GE(bounds(cloud_of(slice)).min.minCoeff(), -1e-6);
    std::uint64_t all = 0;
    for (const OutputFile& file : both().results.levels[3].files)
        if (file.tile) all += file.bytes;
    EXPECT_LT(both().bytes_read, all / 2);
}

TEST(Slice, StaysInTheBoxWhereTheMethodMovesPoints) {
    Pyramid pyramid(source(), {200, 8000}, {CloudFormat::Ply});
    std::get<PyramidJob>(pyramid.results.request.job).options.simplification.method =
        Method::Iterative;
    for (const std::uint64_t points : {3U, 30U, 300U}) {
        const Slice slice = pyramid.slice({.points = points, .box = kEighth});
        EXPECT_EQ(slice.points, points);
        EXPECT_GE(bounds(cloud_of(slice)).min.minCoeff(), 0);
    }
}

TEST(Slice, HasAllPointsOfTheBoxWhenThereAreFewer) {
    std::size_t inside = 0;
    for (const Vec3f& p : source().positions) inside += p.minCoeff() >= 0;
    const Slice slice = both().slice({.points = 5000, .box = kEighth});
    EXPECT_EQ(slice.level, 3U);
    // The tiles' grid takes points across the faces of the box, by half a step.
    EXPECT_NEAR(static_cast<double>(slice.points), static_cast<double>(inside),
                0.01 * static_cast<double>(inside));
}

/// Points of which half lie in the plane z = 0, no others within 0.01 of it.
PointCloud floor_with_points_above(std::size_t n) {
    PointCloud cloud = test::cube(n);
    for (std::size_t i = 0; i < n; ++i) {
        float& z = cloud.positions[i].z();
        z = i % 2 == 0 ? 0.0F : 0.01F + 0.99F * std::abs(z);
    }
    return cloud;
}

TEST(Slice, HasThePointsOnTheFacesOfItsBox) {
    const PointCloud cloud = floor_with_points_above(4'000);
    const Aabb all = bounds(cloud);
    Aabb floor = all;
    floor.max.z() = floor.min.z();
    for (const Formats& formats : {Formats{CloudFormat::Ply, CloudFormat::Glb},
                                   Formats{CloudFormat::Glb}, Formats{CloudFormat::Ply}}) {
        for (const bool adds : {false, true}) {
            const Pyramid pyramid(cloud, {500, 4'000}, formats, 700, adds);
            EXPECT_EQ(pyramid.slice({.points = 4'000, .box = all}).points, 4'000U);
            const Slice slice = pyramid.slice({.points = 4'000, .box = floor});
            EXPECT_EQ(slice.points, 2'000U);
            for (const Vec3f& p : cloud_of(slice).positions) EXPECT_EQ(p.z(), 0.0F);
        }
    }
}

TEST(Slice, OfABoxAroundOnePointIsThatPoint) {
    PointCloud far = test::sphere(5'000);
    for (const Vec3d& origin : {Vec3d(0, 0, 0), Vec3d(5e5, 5e6, 100)}) {
        far.origin = origin;
        const Pyramid pyramid(far, {500, 5'000}, {CloudFormat::Glb});
        for (const std::size_t i : {0U, 77U, 4'321U}) {
            const Vec3d place = origin + far.positions[i].cast<double>();
            const PointCloud cut =
                cloud_of(pyramid.slice({.points = 100, .box = Aabb{place, place}}));
            ASSERT_GE(cut.size(), 1U);
            EXPECT_LE((bounds(cut).min - place).norm(), 1e-6);
            EXPECT_LE((bounds(cut).max - place).norm(), 1e-6);
        }
        const Vec3d beyond = bounds(far).max + Vec3d::Constant(1e-7);
        EXPECT_EQ(refusal(pyramid, {.points = 100, .box = Aabb{beyond, beyond}}),
                  ErrorCode::NotFound);
    }
}

TEST(Slice, StaysInABoxWhoseFacesAreNoFloats) {
    const Pyramid tiles(source(), {200, 8'000}, {CloudFormat::Glb});
    const Aabb box{Vec3d(0.1, -0.7, -0.3), Vec3d(0.9, 0.7, 0.3)};
    const Aabb cut = bounds(cloud_of(tiles.slice({.points = 8'000, .box = box})));
    EXPECT_TRUE((cut.min.array() >= box.min.array()).all()) << cut.min.transpose();
    EXPECT_TRUE((cut.max.array() <= box.max.array()).all()) << cut.max.transpose();
}

TEST(Slice, TakesNoMoreIntoAThinBoxBecauseAnotherAxisHasLargeCoordinates) {
    PointCloud cloud = test::sphere(8'000);  // in floats, as surveyors' coordinates often come
    for (Vec3f& p : cloud.positions) p = 50 * p + Vec3f(500'000, 4'000'000, 100);
    const Pyramid tiles(cloud, {8'000}, {CloudFormat::Glb});
    const double step = tiles.results.levels.front().files.front().tile->step;
    const Aabb all = bounds(cloud);
    const Aabb slab{{all.min.x(), all.min.y(), 99.9}, {all.max.x(), all.max.y(), 100.1}};
    const auto within = [&](double more) {
        return std::ranges::count_if(cloud.positions, [&](const Vec3f& p) {
            return std::abs(static_cast<double>(p.z()) - 100) <= 0.1 + more;
        });
    };
    const auto points =
        static_cast<std::ptrdiff_t>(tiles.slice({.points = 8'000, .box = slab}).points);
    EXPECT_GE(points, within(0));
    EXPECT_LE(points, within(1.01 * step));  // half a step to the grid, and half one beyond
}

TEST(Slice, TakesNoMoreIntoAThinBoxBecauseAPointLiesFarOff) {
    PointCloud cloud = test::sphere(8'000);
    for (Vec3f& p : cloud.positions) p *= 200;
    cloud.origin = Vec3d(500'224, 5'400'064, 512);
    cloud.positions.push_back((-cloud.origin).cast<float>());
    const Pyramid tiles(cloud, {8'001}, {CloudFormat::Glb});
    const double step = tiles.results.levels.front().files.front().tile->step;
    Aabb slab = bounds(cloud);
    slab.min.z() = 511.9;
    slab.max.z() = 512.1;
    const auto within = [&](double more) {
        return std::ranges::count_if(cloud.positions, [&](const Vec3f& p) {
            return std::abs(static_cast<double>(p.z())) <= 0.1 + more;
        });
    };
    const auto points =
        static_cast<std::ptrdiff_t>(tiles.slice({.points = 8'000, .box = slab}).points);
    EXPECT_GE(points, within(0));
    EXPECT_LE(points, within(1.01 * step));
}

}  // namespace
}  // namespace stipple::proto
