#include "analysis/lone_points.hpp"

#include "error/error_samples.hpp"
#include "error/foot_distance.hpp"
#include "stipple/surface_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <random>

// Points off every surface (core/src/analysis/lone_points.hpp): what they weigh and how far they are.

namespace stipple {
namespace {

constexpr std::size_t kGround = 20'000;

/// Rough ground of 10 by 10, and points anywhere up to 30 above it.
PointCloud ground_and_strays(std::size_t strays) {
    std::mt19937 random(7);
    std::uniform_real_distribution<float> side(0, 10), height(3, 30);
    std::normal_distribution<float> noise(0, 0.01F);
    PointCloud cloud;
    for (std::size_t i = 0; i < kGround; ++i)
        cloud.positions.push_back({side(random), side(random), noise(random)});
    for (std::size_t i = 0; i < strays; ++i)
        cloud.positions.push_back({side(random), side(random), height(random)});
    return cloud;
}

struct Scene {
    PointCloud cloud;
    PointTree tree;
    LonePoints points;

    explicit Scene(PointCloud cloud_)
        : cloud(std::move(cloud_)),
          tree(cloud.positions, PointTree::Leaves::Compact, {}),
          points(cloud.positions, tree) {}
};

TEST(LonePoints, AreStraysHoweverManyButNotSparseSurfaces) {
    constexpr float kAny = 1e9F;
    for (const std::size_t strays : {1U, 20U, 100U}) {
        const Scene scene(ground_and_strays(strays));
        std::size_t found = 0;
        for (std::size_t i = kGround; i < scene.cloud.size(); ++i)
            found += scene.points.holds(scene.cloud.positions[i], kAny) ? 1 : 0;
        EXPECT_GE(found, strays * 9 / 10) << strays;
    }
    PointCloud sparse = ground_and_strays(0);  // a wall, points as far apart as strays would be
    for (int y = 0; y < 10; ++y)
        for (int z = 0; z < 10; ++z)
            sparse.positions.push_back(
                {-5, static_cast<float>(y), 5.0F + static_cast<float>(z) + 0.1F * (y % 2)});
    const Scene scene(sparse);
    for (std::size_t i = kGround; i < sparse.size(); ++i)
        EXPECT_FALSE(scene.points.holds(sparse.positions[i], kAny)) << i;
}

TEST(LonePoints, StandForAsMuchAsMostDo) {
    const Scene scene(ground_and_strays(40));
    const PointAreas around = areas_around(scene.points, scene.cloud.positions, {});
    double ground = 0, strays = 0;
    for (std::size_t i = 0; i < kGround; ++i) ground += around.areas[i];
    for (std::size_t i = kGround; i < scene.cloud.size(); ++i) strays += around.areas[i];
    EXPECT_LT(strays / ground, 0.2);  // by the spacing around them it would be nearly all
}

TEST(LonePoints, AreWhereTheirLikeAre) {
    const Foot far = {.distance = 20, .to_sample = 0.01};
    EXPECT_EQ(distance_of(far, 0), 0.01);
    EXPECT_EQ(distance_of(far, 401), 20);
    const Scene scene(ground_and_strays(40));
    EXPECT_EQ(distance_of(far, scene.points, scene.cloud.positions[kGround]), 0.01);
    EXPECT_EQ(distance_of(far, scene.points, scene.cloud.positions[0]), 20);
}

TEST(SurfaceError, IsNotDecidedByStrays) {
    const auto to_fewer = [](std::size_t strays) {  // of the ground every fourth, and all strays
        const PointCloud cloud = ground_and_strays(strays);
        PointCloud fewer;
        for (std::size_t i = 0; i < cloud.size(); i += i < kGround ? 4 : 1)
            fewer.positions.push_back(cloud.positions[i]);
        return measure_error(cloud, fewer).forward;
    };
    const DirectedError without = to_fewer(0);
    for (const std::size_t strays : {1U, 10U, 50U}) {
        const DirectedError with = to_fewer(strays);
        EXPECT_NEAR(with.mean, without.mean, 0.2 * without.mean) << strays;
        EXPECT_LT(with.p99, 1.3 * without.p99) << strays;
    }
    // Those that a candidate lacks are far from it.
    const PointCloud cloud = ground_and_strays(50);
    const DirectedError lost = measure_error(cloud, ground_and_strays(0)).forward;
    EXPECT_GT(lost.max, 10);
}

}  // namespace
}  // namespace stipple
