#include "stipple/hierarchical_clustering.hpp"

#include "support/expect_error.hpp"
#include "support/oracles.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <numeric>
#include <set>

namespace stipple {
namespace {

std::set<std::set<Index>> as_sets(const Clusters& clusters) {
    std::set<std::set<Index>> sets;
    for (std::size_t i = 0; i < clusters.size(); ++i)
        sets.emplace(clusters.of(i).begin(), clusters.of(i).end());
    return sets;
}

std::vector<Index> sorted_members(const Clusters& clusters) {
    std::vector<Index> members = clusters.members;
    std::ranges::sort(members);
    return members;
}

TEST(HierarchicalClustering, BySizeIsThePapersRecursion) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        const auto points = test::cube(800, seed).positions;
        for (const std::uint64_t size : {1U, 2U, 9U, 50U, 799U, 800U}) {
            EXPECT_EQ(as_sets(hierarchical_clusters(points, {.max_cluster_size = size})),
                      test::recursive_clusters(points, size, 1.0));
        }
    }
}

TEST(HierarchicalClustering, ByVariationIsThePapersRecursion) {
    const auto points = test::sphere(1200, 0.02, 3).positions;
    for (const double variation : {0.3, 0.1, 0.02, 0.004}) {
        EXPECT_EQ(as_sets(hierarchical_clusters(points, {.max_variation = variation})),
                  test::recursive_clusters(points, points.size(), variation));
    }
}

TEST(HierarchicalClustering, BySizeAndVariationSplitsWhereEitherSaysSo) {
    const auto points = test::sphere(1200, 0.02, 4).positions;
    EXPECT_EQ(
        as_sets(hierarchical_clusters(points, {.max_cluster_size = 40, .max_variation = 0.01})),
        test::recursive_clusters(points, 40, 0.01));
}

TEST(HierarchicalClustering, FirstSplitsAcrossTheLongestDirection) {
    // A rod along x: the first plane parts its halves.
    PointCloud rod = test::cube(501);
    for (Vec3f& p : rod.positions) p.x() *= 20.0F;
    const Clusters halves = hierarchical_clusters(rod.positions, {.target_size = 2});
    float left_end = 0, right_begin = 20;
    for (const Index i : halves.of(0)) left_end = std::max(left_end, rod.positions[i].x());
    for (const Index i : halves.of(1)) right_begin = std::min(right_begin, rod.positions[i].x());
    const bool in_order = left_end <= right_begin + 0.5F;
    float other_end = 0, other_begin = 20;
    for (const Index i : halves.of(1)) other_end = std::max(other_end, rod.positions[i].x());
    for (const Index i : halves.of(0)) other_begin = std::min(other_begin, rod.positions[i].x());
    EXPECT_TRUE(in_order || other_end <= other_begin + 0.5F);
}

TEST(HierarchicalClustering, APlaneIsNotSplitByVariation) {
    EXPECT_EQ(hierarchical_clusters(test::plane(5000).positions, {.max_variation = 1e-6}).size(),
              1U);
}

TEST(HierarchicalClustering, ByVariationFlatPartsGetFewerClustersThanRoughOnes) {
    PointCloud flat = test::plane(4000);
    PointCloud rough = test::plane(4000, 2);
    const auto waves = [](const Vec3f& p) {
        return 0.1F * std::sin(30.0F * p.x()) * std::sin(30.0F * p.y());
    };
    std::vector<Vec3f> points = flat.positions;
    for (const Vec3f& p : rough.positions) points.emplace_back(p.x() + 2.0F, p.y(), waves(p));
    const PointCloud result = [&] {
        PointCloud both;
        both.positions = points;
        return hierarchical_clustering(both, {.target_size = 400});
    }();
    const auto on_flat =
        std::ranges::count_if(result.positions, [](const Vec3f& p) { return p.x() < 1.5F; });
    EXPECT_LT(on_flat, 160);
    EXPECT_GT(on_flat, 20);  // flat parts stay covered
}

TEST(HierarchicalClustering, EveryPointIsInExactlyOneCluster) {
    const auto points = test::cube(5000).positions;
    const Clusters clusters = hierarchical_clusters(points, {.target_size = 321});
    std::vector<Index> all(points.size());
    std::iota(all.begin(), all.end(), Index{0});
    EXPECT_EQ(sorted_members(clusters), all);
    for (std::size_t i = 0; i < clusters.size(); ++i) EXPECT_FALSE(clusters.of(i).empty());
}

TEST(HierarchicalClustering, ACoarserCutIsMadeOfWholeClustersOfAFinerOne) {
    const auto points = test::sphere(3000, 0.05).positions;
    const Clusters coarse = hierarchical_clusters(points, {.target_size = 70});
    const Clusters fine = hierarchical_clusters(points, {.target_size = 300});
    std::vector<Index> cluster_of(points.size());
    for (std::size_t c = 0; c < coarse.size(); ++c) {
        for (const Index i : coarse.of(c)) cluster_of[i] = static_cast<Index>(c);
    }
    for (std::size_t c = 0; c < fine.size(); ++c) {
        for (const Index i : fine.of(c)) EXPECT_EQ(cluster_of[i], cluster_of[fine.of(c).front()]);
    }
}

TEST(HierarchicalClustering, GivesEveryCountFromOneToAll) {
    const PointCloud cloud = test::sphere(200, 0.1);
    for (std::uint64_t n = 1; n <= 200; ++n) {
        EXPECT_EQ(hierarchical_clustering(cloud, {.target_size = n}).size(), n);
    }
}

TEST(HierarchicalClustering, SplitsPointsThatDifferByOneBit) {
    PointCloud cloud;
    float x = 1.0e6F;
    for (int i = 0; i < 64; ++i, x = std::nextafter(x, 2.0e6F))
        cloud.positions.emplace_back(x, 1.0e6F, -1.0e6F);
    for (std::uint64_t n = 1; n <= 64; ++n)
        EXPECT_EQ(hierarchical_clustering(cloud, {.target_size = n}).size(), n);
}

TEST(HierarchicalClustering, RefusesOptionsThatSayNothingOrTooMuch) {
    const PointCloud cloud = test::cube(10);
    test::expect_refused("hierarchical: expected a target size, max_cluster_size or max_variation",
                         [&] { hierarchical_clustering(cloud, {}); });
    test::expect_refused("target_size 0: expected 1..10",
                         [&] { hierarchical_clustering(cloud, {.target_size = 0}); });
    test::expect_refused("hierarchical: a target size excludes", [&] {
        hierarchical_clustering(cloud, {.target_size = 5, .max_cluster_size = 5});
    });
    test::expect_refused("max_cluster_size 0: expected at least 1",
                         [&] { hierarchical_clustering(cloud, {.max_cluster_size = 0}); });
    test::expect_refused("max_variation 0: expected above 0, at most 1/3",
                         [&] { hierarchical_clustering(cloud, {.max_variation = 0.0}); });
    test::expect_refused("max_variation 0.34: expected above 0, at most 1/3",
                         [&] { hierarchical_clustering(cloud, {.max_variation = 0.34}); });
    test::expect_refused("the cloud has no points",
                         [&] { hierarchical_clustering({}, {.target_size = 5}); });
}

}  // namespace
}  // namespace stipple
