#include "stipple/iterative_simplification.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>

#include <random>

namespace stipple {
namespace {

PointCloud noisy_sphere(std::size_t n) {
    std::mt19937 random(1);
    std::normal_distribution<float> normal;
    PointCloud cloud;
    for (std::size_t i = 0; i < n; ++i)
        cloud.positions.push_back(Vec3f(normal(random), normal(random), normal(random)).normalized());
    return cloud;
}

TEST(IterativeSimplification, GivesEveryCountOfASmallCloud) {
    const PointCloud cloud = noisy_sphere(60);
    for (std::uint64_t size = 1; size <= 60; ++size)
        EXPECT_EQ(iterative_simplification(cloud, {.target_size = size}).size(), size);
}

}  // namespace
}  // namespace stipple
