#include "stipple/splats.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace stipple {
namespace {

/// The part of `places` within the disc of at least one point.
double covered(const std::vector<Vec3f>& points, const std::vector<float>& radii,
               const std::vector<Vec3f>& places) {
    const auto is_covered = [&](const Vec3f& place) {
        for (std::size_t i = 0; i < points.size(); ++i) {
            if ((points[i] - place).squaredNorm() <= radii[i] * radii[i]) return true;
        }
        return false;
    };
    return static_cast<double>(std::ranges::count_if(places, is_covered)) /
           static_cast<double>(places.size());
}

/// How many times over discs would cover the area.
double overlap(const std::vector<float>& radii, double area) {
    double sum = 0;
    for (const float r : radii) sum += std::numbers::pi * r * r;
    return sum / area;
}

/// Points of the unit square, sixteen times as dense on the left as on the right.
std::vector<Vec3f> uneven_plane(std::size_t n) {
    std::vector<Vec3f> points;
    std::mt19937 random(3);
    std::uniform_real_distribution<float> unit(0.0F, 1.0F);
    while (points.size() < n) {
        const float x = unit(random), y = unit(random), density = x < 0.5F ? 1.0F : 0.0625F;
        if (unit(random) < density) points.emplace_back(x, y, 0.0F);
    }
    return points;
}

std::vector<Vec3f> inner(std::vector<Vec3f> places, float margin) {
    std::erase_if(places, [&](const Vec3f& p) {
        return p.head<2>().minCoeff() < margin || p.head<2>().maxCoeff() > 1 - margin;
    });
    return places;
}

TEST(Splats, CoverAPlaneWhoseDensityJumps) {
    const auto points = uneven_plane(1500);
    const Splats splats = measure_splats(points);
    EXPECT_EQ(covered(points, splats.radii, inner(test::plane(20'000, 7).positions, 0.05F)), 1.0);
    EXPECT_LT(overlap(splats.radii, 1), 6);
}

TEST(Splats, CoverASphereSampledAtRandom) {
    std::vector<Vec3f> points, places = test::sphere(20'000).positions;
    std::mt19937 random(1);
    std::normal_distribution<float> normal;
    for (int i = 0; i < 800; ++i)
        points.push_back(Vec3f(normal(random), normal(random), normal(random)).normalized());
    const Splats splats = measure_splats(points);
    EXPECT_EQ(covered(points, splats.radii, places), 1.0);
    EXPECT_LT(overlap(splats.radii, 4 * std::numbers::pi), 5);
}

TEST(Splats, CoverAnEvenSphereLittleMoreThanOnce) {
    const auto points = test::sphere(1000).positions;
    const Splats splats = measure_splats(points);
    EXPECT_EQ(covered(points, splats.radii, test::sphere(20'000).positions), 1.0);
    EXPECT_LT(overlap(splats.radii, 4 * std::numbers::pi), 1.8);  // hexagons: 1.21, squares: 1.57
}

TEST(Splats, OnASquareLatticeReachTheMiddlesOfItsSquares) {
    std::vector<Vec3f> points;
    for (int x = 0; x < 9; ++x) {
        for (int y = 0; y < 9; ++y)
            points.emplace_back(static_cast<float>(x), static_cast<float>(y), 0.0F);
    }
    const Splats splats = measure_splats(points, {.normals = true, .ellipses = true});
    EXPECT_NEAR(splats.radii[40], std::sqrt(0.5F), 1e-5F);
    EXPECT_NEAR(splats.radii[0], 0.75F, 1e-5F);  // two sides open
    EXPECT_NEAR(std::abs(splats.normals[40].z()), 1.0F, 1e-5F);
    EXPECT_NEAR(splats.major[40].norm(), std::sqrt(0.5F), 1e-5F);
    EXPECT_NEAR(splats.minor[40].norm(), std::sqrt(0.5F), 1e-5F);
}

TEST(Splats, AreLongWhereNeighborsAreFar) {
    std::vector<Vec3f> points;
    for (int x = 0; x < 15; ++x) {
        for (int y = 0; y < 15; ++y)
            points.emplace_back(2.0F * static_cast<float>(x), static_cast<float>(y), 0.0F);
    }
    const Splats splats = measure_splats(points, {.normals = true, .ellipses = true});
    const Vec3f major = splats.major[112], minor = splats.minor[112];
    // The least ellipse of that shape through (1, 1/2): half axes 2 and 1 times the root of a half.
    EXPECT_NEAR(std::abs(major.x()), std::sqrt(2.0F), 1e-4F);
    EXPECT_NEAR(std::abs(minor.y()), std::sqrt(0.5F), 1e-4F);
    EXPECT_NEAR(major.cross(minor).normalized().dot(splats.normals[112]), 1.0F, 1e-4F);
}

TEST(Splats, EllipsesCoverAPlaneToo) {
    const auto points = uneven_plane(1500);
    const Splats splats = measure_splats(points, {.ellipses = true});
    const auto places = inner(test::plane(10'000, 7).positions, 0.05F);
    const auto is_covered = [&](const Vec3f& place) {
        for (std::size_t i = 0; i < points.size(); ++i) {
            const Vec3f d = place - points[i];
            const float a = d.dot(splats.major[i]) / splats.major[i].squaredNorm(),
                        b = d.dot(splats.minor[i]) / splats.minor[i].squaredNorm();
            if (a * a + b * b <= 1.0001F) return true;
        }
        return false;
    };
    // All but where the density jumps, across which discs reach and ellipses need not.
    EXPECT_GE(std::ranges::count_if(places, is_covered),
              static_cast<std::ptrdiff_t>(0.998 * static_cast<double>(places.size())));
}

TEST(Splats, AnOutlierDoesNotReachForTheSurface) {
    auto points = test::sphere(500).positions;
    points.emplace_back(50.0F, 0.0F, 0.0F);
    const Splats splats = measure_splats(points);
    EXPECT_GT(splats.radii.back(), 0.0F);
    EXPECT_LT(*std::ranges::max_element(splats.radii), 0.4F);
}

TEST(Splats, OfOnePointAreNothingAndOfTwoWhatIsBetween) {
    EXPECT_TRUE(measure_splats({}).radii.empty());
    const Splats one =
        measure_splats(std::vector<Vec3f>{{1, 2, 3}}, {.normals = true, .ellipses = true});
    EXPECT_EQ(one.radii, std::vector<float>{0.0F});
    EXPECT_NEAR(one.normals[0].norm(), 1.0F, 1e-6F);
    EXPECT_EQ(one.major[0].norm(), 0.0F);
    const Splats two = measure_splats(std::vector<Vec3f>{{0, 0, 0}, {0, 2, 0}},
                                      {.normals = true, .ellipses = true});
    for (const std::size_t i : {0, 1}) {
        EXPECT_GE(two.radii[i], 1.0F);
        EXPECT_LE(two.radii[i], 2.0F);
        EXPECT_NEAR(two.normals[i].y(), 0.0F, 1e-6F);
    }
}

TEST(Splats, OnALineTouchTheNext) {
    const auto points = test::line(100).positions;
    const Splats splats = measure_splats(points, {.normals = true, .ellipses = true});
    const float spacing = (points[1] - points[0]).norm();
    for (std::size_t i = 0; i < points.size(); ++i) {
        EXPECT_GE(splats.radii[i], 0.499F * spacing);
        EXPECT_LE(splats.radii[i], 1.001F * spacing);
        EXPECT_TRUE(splats.normals[i].allFinite() && splats.major[i].allFinite());
    }
}

TEST(Splats, AreTheSameForAnyUnitAndNumberOfThreads) {
    const auto points = uneven_plane(3000);
    const Splats one = measure_splats(points, {.ellipses = true}, {.threads = 1});
    const Splats eight = measure_splats(points, {.ellipses = true}, {.threads = 8});
    EXPECT_EQ(one.radii, eight.radii);
    EXPECT_EQ(one.major, eight.major);
    auto small = points;
    for (Vec3f& p : small) p *= 0x1p-40F;
    const Splats scaled = measure_splats(small);
    for (std::size_t i = 0; i < points.size(); ++i)
        EXPECT_NEAR(scaled.radii[i] * 0x1p40F, one.radii[i], 1e-5F * one.radii[i]);
}

}  // namespace
}  // namespace stipple
