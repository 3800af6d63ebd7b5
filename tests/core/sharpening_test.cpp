#include "progressive/sharpening.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <numbers>

namespace stipple {
namespace {

/// Of a sphere around a corner that no coordinate reaches below, by the golden angle.
std::vector<Cell> sphere(std::size_t n, double radius) {
    std::vector<Cell> places;
    for (std::size_t i = 0; i < n; ++i) {
        const double z = 1 - (2 * static_cast<double>(i) + 1) / static_cast<double>(n);
        const double angle = std::numbers::pi * (3 - std::sqrt(5)) * static_cast<double>(i);
        const double r = std::sqrt(1 - z * z);
        const Vec3d p =
            Vec3d(r * std::cos(angle), r * std::sin(angle), z) * radius + Vec3d::Constant(radius);
        places.push_back({static_cast<std::int32_t>(std::lround(p.x())),
                          static_cast<std::int32_t>(std::lround(p.y())),
                          static_cast<std::int32_t>(std::lround(p.z()))});
    }
    return places;
}

TEST(WaysToSurface, GoIntoWhatIsBent) {
    constexpr double kRadius = 1 << 20;
    constexpr std::size_t kPoints = 2'000;
    const std::vector<Cell> places = sphere(kPoints, kRadius);
    const std::vector<Vec3d> ways = ways_to_surface(places, 17, {});
    // Neighbours at the distance d lie lower by d^2 / 2 radius: about 8 in 9 of that is the mean's.
    const double area = 4 * std::numbers::pi / kPoints;
    const double sagitta = kRadius * area / 2;
    for (std::size_t i = 0; i < kPoints; ++i) {
        const Vec3d up = (Vec3d(places[i][0], places[i][1], places[i][2]) / kRadius - Vec3d::Ones())
                             .normalized();
        EXPECT_LT(up.dot(ways[i]), -0.4 * sagitta);
        EXPECT_GT(up.dot(ways[i]), -1.6 * sagitta);
        EXPECT_LT((ways[i] - up * up.dot(ways[i])).norm(), 0.2 * ways[i].norm());
    }
}

TEST(WaysToSurface, AreNoneWhereThereIsNothingBent) {
    std::vector<Cell> plane;
    for (std::int32_t x = 0; x < 20; ++x)
        for (std::int32_t y = 0; y < 20; ++y) plane.push_back({8 * x, 8 * y, 4 * x});
    for (const Vec3d& way : ways_to_surface(plane, 5, {})) EXPECT_LT(way.norm(), 1e-2);
    const std::vector<Cell> few = {{0, 0, 0}, {100, 0, 0}, {0, 100, 7}};
    for (const Vec3d& way : ways_to_surface(few, 24, {})) EXPECT_EQ(way, Vec3d::Zero());
    EXPECT_TRUE(ways_to_surface({}, 24, {}).empty());
}

TEST(WaysToSurface, AreTheSameForAnyNumberOfThreads) {
    const std::vector<Cell> places = sphere(10'000, 5'000);
    EXPECT_EQ(ways_to_surface(places, 8, {.threads = 1}),
              ways_to_surface(places, 8, {.threads = 3}));
}

}  // namespace
}  // namespace stipple
