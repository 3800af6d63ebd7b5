#include "neighbors/balls.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

// Points within balls (core/src/neighbors/balls.hpp) against a look at every point and ball.

namespace stipple {
namespace {

std::vector<Index> by_all_pairs(std::span<const Ball> balls, std::span<const Vec3f> points) {
    std::vector<Index> found;
    for (Index i = 0; i < points.size(); ++i)
        for (const Ball& ball : balls) {
            if ((points[i] - ball.center).squaredNorm() > ball.radius * ball.radius) continue;
            found.push_back(i);
            break;
        }
    return found;
}

std::vector<Index> found_within(std::span<const Ball> balls, const PointCloud& cloud,
                                unsigned threads = 1) {
    RunContext context;
    context.threads = threads;
    const Aabb box = bounds(cloud);
    return points_within(balls, cloud.positions, box.min.cast<float>(),
                         static_cast<float>(box.diagonal()), context);
}

/// Balls at points of a cloud, their radii between 1 and `times` of the least.
std::vector<Ball> random_balls(const PointCloud& cloud, std::size_t n, float least, double times) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> power(0, std::log(times));
    std::vector<Ball> balls;
    for (std::size_t i = 0; i < n; ++i)
        balls.push_back({cloud.positions[random() % cloud.size()],
                         least * static_cast<float>(std::exp(power(random)))});
    return balls;
}

TEST(PointsWithin, AreThoseOfAllPairs) {
    const PointCloud cloud = test::sphere(20'001);
    for (const std::size_t n : {1U, 30U, 400U}) {
        for (const double times : {1.0, 3.0, 300.0}) {
            const std::vector<Ball> balls = random_balls(cloud, n, 0.01F, times);
            const std::vector<Index> found = found_within(balls, cloud);
            EXPECT_GT(found.size(), 0U);
            EXPECT_EQ(found, by_all_pairs(balls, cloud.positions)) << n << " x " << times;
        }
    }
}

TEST(PointsWithin, AreFoundByBallsOutsideOfTheirBox) {
    const PointCloud cloud = test::sphere(5'000);
    const std::vector<Ball> balls = {
        {Vec3f(-3, 0, 0), 2.1F}, {Vec3f(0, 40, 0), 39.05F}, {Vec3f(1e9F, 0, 0), 1.0F}};
    const std::vector<Index> found = found_within(balls, cloud);
    EXPECT_GT(found.size(), 0U);
    EXPECT_EQ(found, by_all_pairs(balls, cloud.positions));
}

TEST(PointsWithin, AreFoundInCloudsOfAnySize) {
    for (const float size : {1e-30F, 1e30F}) {
        PointCloud cloud = test::sphere(5'000);
        std::vector<Ball> balls = random_balls(cloud, 50, 0.05F, 5);
        const std::vector<Index> expected = by_all_pairs(balls, cloud.positions);
        for (Vec3f& p : cloud.positions) p *= size;
        for (Ball& ball : balls) ball = {size * ball.center, size * ball.radius};
        const std::vector<Index> found = found_within(balls, cloud);
        EXPECT_NEAR(static_cast<double>(found.size()), static_cast<double>(expected.size()), 2);
    }
}

TEST(PointsWithin, AreFoundInASmallPartOfALargeBox) {
    // A millionth of the box: many cells away from its corner, where floats are far apart.
    PointCloud cloud;
    for (const Vec3f& p : test::sphere(3'000).positions)
        cloud.positions.push_back(Vec3f(1, 1, 1) + 1e-6F * p);
    cloud.positions.emplace_back(0, 0, 0);
    for (const float radius : {1e-8F, 1e-7F, 3e-7F, 1e-6F}) {
        const std::vector<Ball> balls = random_balls(cloud, 100, radius, 3);
        EXPECT_EQ(found_within(balls, cloud), by_all_pairs(balls, cloud.positions)) << radius;
    }
}

TEST(PointsWithin, OfABallOfNoSizeAreThoseAtItsCenter) {
    PointCloud cloud = test::sphere(1'000);
    cloud.positions[7] = cloud.positions[900];
    const std::vector<Ball> balls = {{cloud.positions[7], 0.0F}};
    EXPECT_EQ(found_within(balls, cloud), (std::vector<Index>{7, 900}));
    cloud.positions.assign(100, Vec3f(1, 2, 3));
    EXPECT_EQ(found_within({{{Vec3f(1, 2, 3), 0.0F}}}, cloud).size(), 100U);
    EXPECT_EQ(found_within({}, cloud).size(), 0U);
}

TEST(PointsWithin, AreTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::sphere(150'000);
    const std::vector<Ball> balls = random_balls(cloud, 200, 0.01F, 20);
    EXPECT_EQ(found_within(balls, cloud, 1), found_within(balls, cloud, 8));
}

}  // namespace
}  // namespace stipple
