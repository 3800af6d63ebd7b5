#include "stipple/outliers.hpp"

#include "support/expect_error.hpp"
#include "support/expect_same.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <random>

namespace stipple {
namespace {

using Points = std::vector<Vec3f>;

/// n points at random in a cube about the origin.
Points dust(std::size_t n, float half_side, std::uint64_t seed = 7) {
    Points points = test::cube(n, seed).positions;
    for (Vec3f& p : points) p = half_side * (2.0F * p - Vec3f::Ones());
    return points;
}

Points joined(Points points, const Points& others) {
    points.insert(points.end(), others.begin(), others.end());
    return points;
}

/// n points of the unit sphere, each moved by a normal deviate along every axis.
Points noisy_sphere(std::size_t n, double deviation) {
    std::mt19937 random(3);
    std::normal_distribution<float> deviate(0, static_cast<float>(deviation));
    Points points = test::sphere(n).positions;
    for (Vec3f& p : points) p += Vec3f(deviate(random), deviate(random), deviate(random));
    return points;
}

/// A plane with a thousand times as many points per area at one end as at the other.
Points graded_plane(std::size_t n) {
    Points points = test::plane(n, 5).positions;
    for (Vec3f& p : points) p.x() = (std::pow(1000.0F, p.x()) - 1) / 999;
    return points;
}

/// How many of the indices are below `n`, where the good points are.
std::size_t good(const std::vector<Index>& outliers, std::size_t n) {
    return static_cast<std::size_t>(std::ranges::lower_bound(outliers, static_cast<Index>(n)) -
                                    outliers.begin());
}

TEST(Outliers, AreFoundFarFromASurfaceAndNothingElse) {
    const std::size_t n = 20'000;
    const Points points = joined(test::sphere(n).positions, dust(200, 10));
    const std::vector<Index> outliers = find_outliers(points);
    EXPECT_EQ(good(outliers, n), 0U);
    EXPECT_EQ(outliers.size(), 199U);  // one lies beside the sphere
}

TEST(Outliers, AreFoundBesideASurface) {
    // Above the sphere by 4 to 12 spacings, which is 0.025.
    const std::size_t n = 20'000;
    Points near = test::sphere(500).positions;
    for (std::size_t i = 0; i < near.size(); ++i)
        near[i] *= 1.1F + 0.2F * static_cast<float>(i % 10) / 10;
    const std::vector<Index> outliers = find_outliers(joined(test::sphere(n).positions, near));
    EXPECT_EQ(good(outliers, n), 0U);
    EXPECT_EQ(outliers.size(), 500U);
}

TEST(Outliers, AreFoundAmongDensePointsOfAnUnevenCloud) {
    // Too near to be far in the whole cloud, but far for where they are: 0.001 apart.
    const std::size_t n = 30'000;
    Points points = graded_plane(n);
    for (int i = 0; i < 100; ++i) points.emplace_back(0.0005F, static_cast<float>(i) / 100, 0.01F);
    const std::vector<Index> outliers = find_outliers(points);
    EXPECT_LE(good(outliers, n), n / 1000);
    EXPECT_EQ(outliers.size() - good(outliers, n), 100U);
}

TEST(Outliers, AreNotTheSparsePartsOfASurface) {
    const Points points = graded_plane(30'000);
    EXPECT_LE(find_outliers(points).size(), 30U);
}

TEST(Outliers, AreNotTheThinPartsOfAScan) {
    // A wire with a tenth of the points per length over dense ground.
    Points points = test::plane(20'000).positions;
    for (int i = 0; i < 50; ++i) points.emplace_back(static_cast<float>(i) / 50, 0.5F, 2.0F);
    EXPECT_EQ(find_outliers(points).size(), 0U);
}

TEST(Outliers, AreHardlyEverPointsOfNoise) {
    const std::size_t n = 20'000;
    EXPECT_LE(find_outliers(noisy_sphere(n, 0.02)).size(), n / 2000);  // about a spacing
    EXPECT_EQ(find_outliers(test::cube(n).positions).size(), 0U);
}

TEST(Outliers, AreNotTheBorderOfAVoxelGrid) {
    Points points;
    for (int i = 0; i < 8000; ++i) points.emplace_back(i % 20, i / 20 % 20, i / 400);
    EXPECT_EQ(find_outliers(points).size(), 0U);
}

TEST(Outliers, OneFarAwayHidesNoOther) {
    const std::size_t n = 10'000;
    Points points = joined(test::sphere(n).positions, {{2, 0, 0}, {1e6F, 0, 0}});
    EXPECT_EQ(find_outliers(points), (std::vector<Index>{10'000, 10'001}));
}

TEST(Outliers, AreFewerWithMoreDeviations) {
    const Points points = joined(test::sphere(5'000).positions, dust(1'000, 2));
    std::size_t before = points.size();
    for (const double deviations : {1.0, 2.0, 3.0, 5.0, 100.0}) {
        const std::size_t found = find_outliers(points, {.deviations = deviations}).size();
        EXPECT_LE(found, before) << deviations;
        before = found;
    }
    EXPECT_EQ(before, 0U);
}

TEST(Outliers, AreTheSameForAnyNumberOfThreads) {
    const Points points = joined(noisy_sphere(30'000, 0.01), dust(300, 3));
    const std::vector<Index> outliers = find_outliers(points, {}, {.threads = 1});
    EXPECT_GT(outliers.size(), 200U);
    EXPECT_EQ(find_outliers(points, {}, {.threads = 7}), outliers);
}

TEST(Outliers, AreNoneAmongTooFewPointsToTell) {
    for (std::size_t n = 0; n < 13; ++n) {
        Points points = test::sphere(n).positions;
        if (n > 0) points.back() = {1e6F, 0, 0};
        EXPECT_TRUE(find_outliers(points).empty()) << n;
    }
}

TEST(Outliers, AreToldWhereSquaresOfDistancesVanish) {
    Points points;
    for (int i = 0; i < 100; ++i) points.emplace_back(1e-30F * static_cast<float>(i), 0, 0);
    points.emplace_back(1, 0, 0);
    EXPECT_EQ(find_outliers(points), std::vector<Index>{100});
}

TEST(RemoveOutliers, KeepsTheOrderAndTheAttributesOfTheRest) {
    PointCloud cloud = test::sphere(5'000);
    cloud.positions.insert(cloud.positions.begin() + 1000, {5, 5, 5});
    cloud.positions.emplace_back(0, 9, 0);
    cloud = test::with_attributes(cloud);
    EXPECT_EQ(remove_outliers(cloud), 2U);
    test::expect_same(cloud, test::with_attributes(test::sphere(5'000)));
    EXPECT_EQ(remove_outliers(cloud), 0U);
}

TEST(RemoveOutliers, RefusesDeviationsOutOfRange) {
    for (const double deviations : {0.5, -3.0, 101.0, std::nan("")}) {
        PointCloud cloud = test::sphere(100);
        EXPECT_THROW(remove_outliers(cloud, {.deviations = deviations}), Error) << deviations;
    }
    test::expect_refused("remove_outliers 0.5: expected 1..100 standard deviations",
                         [] { validate(OutlierOptions{.deviations = 0.5}); });
}

}  // namespace
}  // namespace stipple
