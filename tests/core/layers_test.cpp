#include "clustering/layers.hpp"

#include "clustering/gather.hpp"
#include "stipple/hierarchical_clustering.hpp"
#include "stipple/iterative_simplification.hpp"
#include "stipple/multiphase.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <cmath>
#include <numeric>
#include <random>
#include <vector>

namespace stipple {
namespace {

/// The plane that is found between layers of points.
std::optional<SplitPlane> plane_between(std::span<const Vec3f> points) {
    std::vector<Index> numbers(points.size());
    std::iota(numbers.begin(), numbers.end(), Index{0});
    Samples samples(points.size());
    gather(points, numbers, samples.all());
    const SampleMoments moments = moments_about(samples.all(), {0, 0, 0});
    const Spread spread = cluster_kernels().spreads({moments.scatter, {}, {}, {}})[0];
    return plane_between_layers(samples.all(), moments, spread);
}

TEST(Layers, AreToldApartHoweverTheyLie) {
    std::mt19937_64 random(1);
    std::uniform_real_distribution<float> coordinate(-1, 1);
    for (const std::size_t n : {256U, 1000U, 5000U}) {
        const float gap = 3 / std::sqrt(static_cast<float>(n));  // two spacings of a side
        std::vector<Vec3f> points = test::wall(n, gap, n).positions;
        const Vec3f axis = Vec3f(coordinate(random), coordinate(random), coordinate(random));
        const auto turn = Eigen::AngleAxisf(coordinate(random), axis.normalized());
        for (Vec3f& p : points) p = turn * p;
        const auto plane = plane_between(points);
        ASSERT_TRUE(plane) << n;
        for (std::size_t i = 0; i < n; ++i) {
            const Vec3f normal(plane->normal.data()), reference(plane->reference.data());
            const bool left = normal.dot(points[i] - reference) < plane->offset;
            const bool first_left = normal.dot(points[0] - reference) < plane->offset;
            EXPECT_EQ(left == first_left, i % 2 == 0);
        }
    }
}

TEST(Layers, AreNotFoundInOneSheetNorInNoise) {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
        auto points = test::plane(2000, seed).positions;
        EXPECT_FALSE(plane_between(points));
        for (Vec3f& p : points) p.z() = p.x() * p.x();
        EXPECT_FALSE(plane_between(points));
        EXPECT_FALSE(plane_between(test::sphere(2000, 0.1, seed).positions));
        EXPECT_FALSE(plane_between(test::cube(2000, seed).positions));
    }
}

TEST(Layers, CloserThanTheirPointsAreToEachOtherAreOneSheet) {
    EXPECT_FALSE(plane_between(test::wall(1000, 0.03F).positions));
    EXPECT_TRUE(plane_between(test::wall(1000, 0.1F).positions));
}

TEST(Layers, OfFewPointsMayBeChance) {
    EXPECT_FALSE(plane_between(test::wall(31, 0.5F).positions));
}

TEST(Layers, AFewPointsFarOffAreNone) {
    auto points = test::plane(1000).positions;
    points[500].z() = 10;
    EXPECT_FALSE(plane_between(points));
}

constexpr std::size_t kPoints = 20'000;
constexpr float kGap = 0.04F;  // four spacings of a side

/// Whether all points are on the sides of the wall, and as red or blue as these are; on each at
/// least two fifths of them.
void expect_apart(const PointCloud& cloud, float tolerance) {
    std::size_t red = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const bool is_red = cloud.positions[i].z() < kGap / 2;
        EXPECT_NEAR(cloud.positions[i].z(), is_red ? 0 : kGap, tolerance * kGap);
        EXPECT_EQ(cloud.colors[i].r, is_red ? 255 : 0);
        EXPECT_EQ(cloud.colors[i].b, is_red ? 0 : 255);
        red += is_red ? 1 : 0;
    }
    EXPECT_GE(5 * red, 2 * cloud.size());
    EXPECT_LE(5 * red, 3 * cloud.size());
}

// With 1000, 200 and 50 points, those of one side are 1.1, 2.5 and 5 gaps from each other.
TEST(Layers, AreKeptApartByMultiphase) {
    const PointCloud wall = test::wall(kPoints, kGap);
    for (const std::uint64_t size : {1000U, 200U, 50U}) {
        MultiphaseOptions options;
        options.contraction.target_size = size;
        expect_apart(multiphase(wall, options), 0.15F);
    }
}

TEST(Layers, AreKeptApartByIterativeSimplification) {
    const PointCloud wall = test::wall(kPoints, kGap);
    for (const std::uint64_t size : {1000U, 200U})
        expect_apart(iterative_simplification(wall, {.target_size = size}), 0.15F);
}

TEST(Layers, AreKeptApartByCentroidsOfHierarchicalClustering) {
    const PointCloud wall = test::wall(kPoints, kGap);
    for (const std::uint64_t size : {1000U, 200U, 20U}) {
        expect_apart(hierarchical_clustering(
                         wall, {.target_size = size, .representative = Representative::Centroid}),
                     1e-5F);
    }
}

}  // namespace
}  // namespace stipple
