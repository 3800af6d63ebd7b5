#include "stipple/random_sampling.hpp"

#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <map>

namespace stipple {
namespace {

/// n points whose x is their number.
PointCloud numbered(std::size_t n) {
    PointCloud cloud;
    for (std::size_t i = 0; i < n; ++i) cloud.positions.emplace_back(static_cast<float>(i), 0, 0);
    return cloud;
}

TEST(RandomSampling, KeepsExactlyTheCountInTheOrderOfTheInput) {
    const PointCloud cloud = numbered(1000);
    for (const std::uint64_t n : {1U, 2U, 10U, 500U, 999U, 1000U}) {
        const PointCloud sample = random_sampling(cloud, {.target_size = n, .seed = n});
        ASSERT_EQ(sample.size(), n);
        const auto not_after = [](const Vec3f& a, const Vec3f& b) { return a.x() >= b.x(); };
        EXPECT_EQ(std::ranges::adjacent_find(sample.positions, not_after), sample.positions.end());
    }
}

TEST(RandomSampling, EverySubsetIsEquallyLikely) {
    const PointCloud cloud = numbered(6);
    std::map<std::vector<float>, int> counts;
    constexpr int kDraws = 20'000;
    for (std::uint64_t seed = 0; seed < kDraws; ++seed) {
        std::vector<float> subset;
        for (const Vec3f& p : random_sampling(cloud, {.target_size = 3, .seed = seed}).positions)
            subset.push_back(p.x());
        ++counts[subset];
    }
    ASSERT_EQ(counts.size(), 20U);  // 6 choose 3
    const double expected = kDraws / 20.0;
    double chi_squared = 0;
    for (const auto& [subset, count] : counts)
        chi_squared += (count - expected) * (count - expected) / expected;
    EXPECT_LT(chi_squared, 43.8);  // 19 degrees of freedom, 1 in 1000
}

TEST(RandomSampling, DependsOnTheSeedAlone) {
    const PointCloud cloud = test::with_attributes(test::sphere(1000));
    const PointCloud a = random_sampling(cloud, {.target_size = 100, .seed = 5});
    EXPECT_EQ(a.positions, random_sampling(cloud, {.target_size = 100, .seed = 5}).positions);
    EXPECT_NE(a.positions, random_sampling(cloud, {.target_size = 100, .seed = 6}).positions);
}

TEST(RandomSampling, KeepsThePointsWithAllTheyHave) {
    const PointCloud cloud = test::with_attributes(test::sphere(1000));
    const PointCloud sample = random_sampling(cloud, {.target_size = 100});
    const auto& height = std::get<std::vector<float>>(find_attribute(sample, "height")->values);
    for (std::size_t i = 0; i < sample.size(); ++i) {
        EXPECT_EQ(height[i], sample.positions[i].z());
        EXPECT_EQ(sample.normals[i], sample.positions[i].normalized());
    }
}

TEST(RandomSampling, RefusesNoPoints) {
    test::expect_refused("the cloud has no points",
                         [&] { random_sampling({}, {.target_size = 1}); });
    test::expect_refused("target_size 0: expected 1..3", [&] { random_sampling(numbered(3), {}); });
    EXPECT_EQ(random_sampling(numbered(3), {.target_size = 7}).size(), 3U);
}

}  // namespace
}  // namespace stipple
