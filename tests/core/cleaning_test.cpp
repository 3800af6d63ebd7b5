#include "stipple/cleaning.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>
#include <set>
#include <tuple>

namespace stipple {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

PointCloud numbered(std::vector<Vec3f> positions) {
    PointCloud cloud;
    cloud.positions = std::move(positions);
    std::vector<std::int32_t> number;
    for (std::size_t i = 0; i < cloud.size(); ++i) number.push_back(static_cast<std::int32_t>(i));
    cloud.attributes.push_back({"number", std::move(number), 1, Reduction::Nearest});
    return cloud;
}

std::vector<std::int32_t> numbers(const PointCloud& cloud) {
    return std::get<std::vector<std::int32_t>>(cloud.attributes.front().values);
}

TEST(Clean, LeavesACleanCloudAsItIs) {
    PointCloud cloud = test::with_attributes(test::sphere(1000));
    const PointCloud before = cloud;
    const CleaningReport report = clean(cloud);
    EXPECT_EQ(report.removed(), 0U);
    EXPECT_EQ(cloud.positions, before.positions);
    EXPECT_EQ(cloud.colors, before.colors);
}

TEST(Clean, RemovesAndCountsPointsWithANonFiniteCoordinate) {
    PointCloud cloud = numbered(
        {{0, 0, 0}, {kNaN, 0, 0}, {1, 0, 0}, {0, kInfinity, 0}, {0, 0, -kInfinity}, {2, 0, 0}});
    const CleaningReport report = clean(cloud);
    EXPECT_EQ(report.non_finite, 3U);
    EXPECT_EQ(report.duplicates, 0U);
    EXPECT_EQ(numbers(cloud), (std::vector<std::int32_t>{0, 2, 5}));
}

TEST(Clean, KeepsTheFirstOfEqualPoints) {
    PointCloud cloud = numbered({{1, 1, 1}, {2, 2, 2}, {1, 1, 1}, {2, 2, 2}, {3, 3, 3}, {1, 1, 1}});
    const CleaningReport report = clean(cloud);
    EXPECT_EQ(report.duplicates, 3U);
    EXPECT_EQ(numbers(cloud), (std::vector<std::int32_t>{0, 1, 4}));
}

TEST(Clean, TakesMinusZeroForZero) {
    PointCloud cloud = numbered({{0.0F, 1, 0.0F}, {-0.0F, 1, 0.0F}, {0.0F, 1, -0.0F}});
    EXPECT_EQ(clean(cloud).duplicates, 2U);
}

TEST(Clean, LeavesOnePointOfEqualOnes) {
    PointCloud cloud = numbered(std::vector<Vec3f>(50'000, Vec3f(1, 2, 3)));
    EXPECT_EQ(clean(cloud).duplicates, 49'999U);
    EXPECT_EQ(numbers(cloud), (std::vector<std::int32_t>{0}));
}

TEST(Clean, LeavesNothingOfACloudOfNaNs) {
    PointCloud cloud = numbered(std::vector<Vec3f>(100, Vec3f(kNaN, 0, 0)));
    EXPECT_EQ(clean(cloud).non_finite, 100U);
    EXPECT_TRUE(cloud.empty());
    EXPECT_TRUE(numbers(cloud).empty());
}

TEST(Clean, FindsTheDuplicatesThatASetFinds) {
    // Coarse coordinates, so that about half of the points stand at the position of another.
    PointCloud cloud = test::cube(200'000);
    for (Vec3f& p : cloud.positions) p = (p * 50.0F).array().round().matrix();
    cloud = numbered(cloud.positions);
    std::set<std::tuple<float, float, float>> seen;
    std::vector<std::int32_t> expected;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const Vec3f& p = cloud.positions[i];
        if (seen.emplace(p.x(), p.y(), p.z()).second)
            expected.push_back(static_cast<std::int32_t>(i));
    }
    const std::size_t before = cloud.size();
    const CleaningReport report = clean(cloud, {.threads = 3});
    EXPECT_EQ(numbers(cloud), expected);
    EXPECT_EQ(report.duplicates, before - expected.size());
}

TEST(Clean, MakesNormalsThatAreNotFiniteZero) {
    PointCloud cloud = numbered({{0, 0, 0}, {1, 0, 0}});
    cloud.normals = {{0, 0, 1}, {kNaN, 0, 1}};
    clean(cloud);
    EXPECT_EQ(cloud.normals[0], Vec3f(0, 0, 1));
    EXPECT_EQ(cloud.normals[1], Vec3f(0, 0, 0));
}

}  // namespace
}  // namespace stipple
