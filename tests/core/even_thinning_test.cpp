#include "even_thinning.hpp"

#include "random.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>

#include <algorithm>

namespace stipple {
namespace {

/// A square, its left half with a hundred times as many points as the right.
PointCloud uneven_plane(std::size_t n) {
    const PointCloud even = test::plane(n);
    PointCloud cloud;
    for (std::size_t i = 0; i < even.size(); ++i) {
        const Vec3f& p = even.positions[i];
        if (p.x() < 0.5F || random_bits(0, i) % 100 == 0) cloud.positions.push_back(p);
    }
    return cloud;
}

std::size_t on_the_right(const PointCloud& cloud) {
    return static_cast<std::size_t>(
        std::ranges::count_if(cloud.positions, [](const Vec3f& p) { return p.x() >= 0.5F; }));
}

TEST(EvenThinning, LeavesSparsePartsAsTheyAre) {
    const PointCloud cloud = uneven_plane(300'000);
    const PointCloud other = test::plane(800);
    const std::optional<PointCloud> thinned = thinned_for(other, cloud, {});
    ASSERT_TRUE(thinned);
    EXPECT_LT(thinned->size(), cloud.size() * 2 / 5);
    EXPECT_GE(thinned->size(), cloud.size() / 4);
    EXPECT_GT(on_the_right(*thinned), on_the_right(cloud) * 9 / 10);
}

TEST(EvenThinning, LeavesSixteenPointsForEachOfTheOther) {
    const PointCloud cloud = test::plane(200'000), other = test::plane(5'000, 2);
    const std::optional<PointCloud> thinned = thinned_for(other, cloud, {});
    ASSERT_TRUE(thinned);
    EXPECT_GT(thinned->size(), 16 * other.size());  // a third would be 66,667
    EXPECT_LT(thinned->size(), cloud.size() / 2);
}

TEST(EvenThinning, KeepsTheOriginAndTheOrder) {
    PointCloud cloud = test::plane(200'000);
    cloud.origin = {1e6, 0, -5};
    PointCloud other = test::plane(500);
    other.origin = cloud.origin;
    const std::optional<PointCloud> thinned = thinned_for(other, cloud, {});
    ASSERT_TRUE(thinned);
    EXPECT_EQ(thinned->origin, cloud.origin);
    auto from = cloud.positions.begin();
    for (const Vec3f& p : thinned->positions) {
        from = std::find(from, cloud.positions.end(), p);
        ASSERT_NE(from, cloud.positions.end());
        ++from;
    }
}

TEST(EvenThinning, IsNotForFewPointsOrNearlyAsManyOfTheOther) {
    EXPECT_FALSE(thinned_for(test::plane(500), test::plane(90'000), {}));
    EXPECT_FALSE(thinned_for(test::plane(50'000), test::plane(200'000), {}));
    EXPECT_FALSE(thinned_for({}, test::plane(200'000), {}));
}

TEST(EvenThinning, TakesEvenPartsOfAPlaceThatAllPointsShareAndOfALine) {
    PointCloud same, line;
    for (std::size_t i = 0; i < 120'000; ++i) {
        same.positions.push_back({1, 2, 3});
        line.positions.push_back({static_cast<float>(i), 0, 0});
    }
    for (const PointCloud* const cloud : {&same, &line}) {
        const std::optional<PointCloud> thinned = thinned_for(test::plane(50), *cloud, {});
        ASSERT_TRUE(thinned);
        EXPECT_GE(thinned->size(), cloud->size() / 3 - 1);
        EXPECT_LT(thinned->size(), cloud->size() / 2);
    }
}

}  // namespace
}  // namespace stipple
