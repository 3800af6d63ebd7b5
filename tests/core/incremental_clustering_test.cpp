#include "stipple/incremental_clustering.hpp"

#include "base/random.hpp"
#include "stipple/hierarchical_clustering.hpp"
#include "stipple/neighbors.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace stipple {
namespace {

/// Deviation over mean of the distances to the nearest other point.
double spacing_variation(const PointCloud& cloud) {
    const NeighborLists nearest = k_nearest_neighbors(cloud.positions, 1);
    double sum = 0, squares = 0;
    for (const float d : nearest.distances_sq) {
        sum += std::sqrt(static_cast<double>(d));
        squares += static_cast<double>(d);
    }
    const double n = static_cast<double>(cloud.size());
    return std::sqrt(std::max(0.0, squares / n - sum * sum / (n * n))) / (sum / n);
}

TEST(IncrementalClustering, GivesEveryCountFromOneToAll) {
    const PointCloud cloud = test::sphere(200, 0.1);
    for (std::uint64_t n = 1; n <= 201; ++n) {
        EXPECT_EQ(incremental_clustering(cloud, {.target_size = n}).size(),
                  std::min<std::size_t>(n, 200));
        EXPECT_EQ(incremental_clustering(cloud, {.target_size = n, .max_variation = 0.02}).size(),
                  std::min<std::size_t>(n, 200));
    }
}

TEST(IncrementalClustering, EveryPointIsInExactlyOneCluster) {
    const auto points = test::cube(5000).positions;
    const Clusters clusters = incremental_clusters(points, {.target_size = 321});
    std::vector<Index> members = clusters.members, all(points.size());
    std::ranges::sort(members);
    std::iota(all.begin(), all.end(), Index{0});
    EXPECT_EQ(members, all);
    for (std::size_t i = 0; i < clusters.size(); ++i) EXPECT_FALSE(clusters.of(i).empty());
}

TEST(IncrementalClustering, EndsWhereMostPointsAreNearerThanSquaresTell) {
    PointCloud cloud;
    for (int i = 0; i < 400; ++i)
        cloud.positions.emplace_back(1e-30F * static_cast<float>(i), 0, 0);
    cloud.positions.emplace_back(1, 1, 1);
    EXPECT_EQ(incremental_clustering(cloud, {.target_size = 50}).size(), 50U);
}

TEST(IncrementalClustering, ClustersAreAllAboutOfOneSize) {
    const auto points = test::sphere(30'000).positions;
    const Clusters clusters = incremental_clusters(points, {.target_size = 1000});
    ASSERT_EQ(clusters.size(), 1000U);
    for (std::size_t i = 0; i < clusters.size(); ++i) {
        EXPECT_GE(clusters.of(i).size(), 10U);
        EXPECT_LE(clusters.of(i).size(), 60U);
    }
}

TEST(IncrementalClustering, SpreadsPointsMoreEvenlyThanTheHierarchy) {
    const PointCloud cloud = test::sphere(30'000, 0.01);
    const auto of_centroids = [&](const auto& clustering, auto options) {
        options.target_size = 1000;
        options.representative = Representative::Centroid;
        return spacing_variation(clustering(cloud, options, RunContext{}));
    };
    const double incremental = of_centroids(incremental_clustering, IncrementalClusteringOptions{});
    EXPECT_LT(incremental, 0.15);
    EXPECT_LT(incremental, of_centroids(hierarchical_clustering, HierarchicalClusteringOptions{}));
}

/// How far a point of the cloud is from all that are left.
double largest_gap(const PointCloud& cloud, const PointCloud& left) {
    float largest_sq = 0;
    for (const Vec3f& p : cloud.positions) {
        float nearest_sq = std::numeric_limits<float>::infinity();
        for (const Vec3f& q : left.positions)
            nearest_sq = std::min(nearest_sq, (p - q).squaredNorm());
        largest_sq = std::max(largest_sq, nearest_sq);
    }
    return std::sqrt(largest_sq);
}

/// A sphere in whose lower half points are 30 times as sparse.
PointCloud uneven_sphere(std::uint64_t points) {
    PointCloud cloud;
    for (std::uint64_t i = 0; cloud.size() < points; ++i) {
        const double z = std::lerp(-1.0, 1.0, random_unit(0, i)), ring = std::sqrt(1 - z * z);
        const double angle = 2 * std::numbers::pi * random_unit(1, i);
        if (z > 0 || random_unit(2, i) < 1.0 / 30)
            cloud.positions.emplace_back(
                Vec3d(ring * std::cos(angle), ring * std::sin(angle), z).cast<float>());
    }
    return cloud;
}

TEST(IncrementalClustering, OfACountLeavesNoGapsWhereItIsSparse) {
    const PointCloud cloud = uneven_sphere(8'000);
    for (const std::uint64_t size : {5, 20, 100}) {
        const PointCloud grown = incremental_clustering(cloud, {.max_cluster_size = size}),
                         counted = incremental_clustering(cloud, {.target_size = grown.size()});
        ASSERT_EQ(counted.size(), grown.size());
        EXPECT_LT(largest_gap(cloud, counted), 0.7 * largest_gap(cloud, grown)) << size;
    }
}

TEST(IncrementalClustering, OfABoundedSizeOnlyStraysMakeClustersLarger) {
    const auto points = test::sphere(20'000).positions;
    const Clusters clusters = incremental_clusters(points, {.max_cluster_size = 20});
    std::size_t larger = 0;
    for (std::size_t i = 0; i < clusters.size(); ++i) {
        EXPECT_GE(clusters.of(i).size(), 10U);  // half the bound, or it would be strays itself
        larger += clusters.of(i).size() > 20;
    }
    EXPECT_LT(larger, clusters.size() / 2);
    EXPECT_NEAR(static_cast<double>(clusters.size()), 1000, 100);
}

/// Points of the cube's surface, and which are within `margin` of an edge.
PointCloud cube_surface(std::size_t n) {
    PointCloud cloud = test::cube(n);
    for (std::size_t i = 0; i < n; ++i)
        cloud.positions[i][static_cast<Eigen::Index>(i % 3)] = i % 2 == 0 ? 0.0F : 1.0F;
    return cloud;
}

bool is_near_an_edge(const Vec3f& p, float margin) {
    int near = 0;
    for (const float c : {p.x(), p.y(), p.z()}) near += c < margin || c > 1 - margin;
    return near >= 2;
}

TEST(IncrementalClustering, ABoundOnTheVariationPutsMoreClustersAtEdges) {
    const PointCloud cloud = cube_surface(20'000);
    const auto share_near_edges = [&](std::optional<double> max_variation) {
        const PointCloud result =
            incremental_clustering(cloud, {.target_size = 600, .max_variation = max_variation});
        EXPECT_EQ(result.size(), 600U);
        return static_cast<double>(std::ranges::count_if(
                   result.positions, [](const Vec3f& p) { return is_near_an_edge(p, 0.05F); })) /
               600;
    };
    EXPECT_GT(share_near_edges(0.01), 1.5 * share_near_edges({}));
}

TEST(IncrementalClustering, ABoundOnTheVariationAloneAdaptsToTheShape) {
    const auto plane = test::plane(5000).positions, sphere = test::sphere(5000).positions;
    const IncrementalClusteringOptions bound = {.max_variation = 0.01};
    EXPECT_LT(incremental_clusters(plane, bound).size(), 5U);
    EXPECT_GT(incremental_clusters(sphere, bound).size(), 20U);
}

TEST(IncrementalClustering, GivesTheCountAlsoWherePointsCoincide) {
    PointCloud cloud = test::cube(500);
    cloud.positions.insert(cloud.positions.end(), 3000, Vec3f(1, 2, 3));
    EXPECT_EQ(incremental_clustering(cloud, {.target_size = 100}).size(), 100U);
}

TEST(IncrementalClustering, DependsOnTheSeed) {
    const PointCloud cloud = test::sphere(3000, 0.01);
    const auto with_seed = [&](std::uint64_t seed) {
        return incremental_clustering(cloud, {.target_size = 100, .seed = seed}).positions;
    };
    EXPECT_EQ(with_seed(1), with_seed(1));
    EXPECT_NE(with_seed(1), with_seed(2));
}

TEST(IncrementalClustering, RefusesOptionsThatSayNothingOrTooMuch) {
    const PointCloud cloud = test::cube(10);
    test::expect_refused("the cloud has no points",
                         [&] { incremental_clustering({}, {.target_size = 5}); });
    test::expect_refused("incremental: expected a target size, max_cluster_size or max_variation",
                         [&] { incremental_clustering(cloud, {}); });
    test::expect_refused("target_size 0: expected 1..10",
                         [&] { incremental_clustering(cloud, {.target_size = 0}); });
    test::expect_refused("a target size excludes max_cluster_size", [&] {
        incremental_clustering(cloud, {.target_size = 5, .max_cluster_size = 5});
    });
    test::expect_refused("max_cluster_size 0: expected at least 1",
                         [&] { incremental_clustering(cloud, {.max_cluster_size = 0}); });
    for (const double variation : {0.0, -1.0, 0.34, std::nan("")})
        test::expect_refused(": expected above 0, at most 1/3",
                             [&] { incremental_clustering(cloud, {.max_variation = variation}); });
}

}  // namespace
}  // namespace stipple
