#include "stipple/voxel_clustering.hpp"

#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

namespace stipple {
namespace {

/// The points of each cell of the grid on the least corner, by a map.
std::set<std::vector<Index>> cells_by_map(const std::vector<Vec3f>& points, double size) {
    Vec3f low = points.front();
    for (const Vec3f& p : points) low = low.cwiseMin(p);
    std::map<std::array<double, 3>, std::vector<Index>> cells;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Vec3d c = ((points[i].cast<double>() - low.cast<double>()) / size).array().floor();
        cells[{c.x(), c.y(), c.z()}].push_back(static_cast<Index>(i));
    }
    std::set<std::vector<Index>> sets;
    for (const auto& [cell, members] : cells) sets.insert(members);
    return sets;
}

std::set<std::vector<Index>> as_sets(const Clusters& clusters) {
    std::set<std::vector<Index>> sets;
    for (std::size_t i = 0; i < clusters.size(); ++i)
        sets.emplace(clusters.of(i).begin(), clusters.of(i).end());
    return sets;
}

TEST(VoxelClustering, OfASizeIsTheCellsOfTheGrid) {
    const auto points = test::sphere(5000, 0.1).positions;
    for (const double size : {0.01, 0.1, 0.37, 1.0, 5.0}) {
        EXPECT_EQ(as_sets(voxel_clusters(points, {.voxel_size = size})),
                  cells_by_map(points, size));
    }
}

TEST(VoxelClustering, TheGridStandsOnTheLeastCorner) {
    PointCloud cloud;
    for (const float x : {10.25F, 10.5F, 10.75F, 11.0F, 11.25F, 11.5F})
        cloud.positions.emplace_back(x, -3.0F, 7.0F);
    const Clusters clusters = voxel_clusters(cloud.positions, {.voxel_size = 0.75});
    EXPECT_EQ(clusters.offsets, (std::vector<Index>{0, 3, 6}));
    EXPECT_EQ(clusters.members, (std::vector<Index>{0, 1, 2, 3, 4, 5}));
}

TEST(VoxelClustering, TheSearchComesCloseToTheTargetFromBelow) {
    for (const auto& points : {test::sphere(50'000).positions, test::sphere(50'000, 0.1).positions,
                               test::plane(50'000).positions}) {
        for (const std::uint64_t target : {50U, 700U, 4000U}) {
            const std::size_t found = voxel_clusters(points, {.target_size = target}).size();
            EXPECT_LE(found, target);
            EXPECT_GE(static_cast<double>(found), 0.9 * static_cast<double>(target));
        }
    }
}

TEST(VoxelClustering, GivesEveryCountFromOneToAll) {
    const PointCloud cloud = test::sphere(200, 0.1);
    for (std::uint64_t n = 1; n <= 201; ++n) {
        EXPECT_EQ(voxel_clustering(cloud, {.target_size = n}).size(),
                  std::min<std::size_t>(n, 200));
    }
}

TEST(VoxelClustering, GivesEveryCountWhateverTheExtent) {
    for (const float scale : {1e-37F, 1e-3F, 1e37F}) {
        PointCloud cloud = test::cube(300);
        for (Vec3f& p : cloud.positions) p *= scale;
        cloud.positions.emplace_back(0.0F, 0.0F, 3.4e38F);  // makes a cell of all the others
        for (const std::uint64_t n : {1U, 2U, 17U, 300U})
            EXPECT_EQ(voxel_clustering(cloud, {.target_size = n}).size(), n) << scale;
    }
}

TEST(VoxelClustering, CentroidsOfALatticeAreTheMiddlesOfItsCells) {
    PointCloud cloud;
    for (int x = 0; x < 4; ++x) {
        for (int y = 0; y < 4; ++y)
            cloud.positions.emplace_back(static_cast<float>(x), static_cast<float>(y), 2.0F);
    }
    const PointCloud result =
        voxel_clustering(cloud, {.voxel_size = 2.0, .representative = Representative::Centroid});
    const std::vector<Vec3f> expected = {
        {0.5F, 0.5F, 2}, {0.5F, 2.5F, 2}, {2.5F, 0.5F, 2}, {2.5F, 2.5F, 2}};
    EXPECT_EQ(result.positions, expected);
}

TEST(VoxelClustering, RefusesOptionsThatSayNothingOrTooMuch) {
    const PointCloud cloud = test::cube(100);
    test::expect_refused("the cloud has no points",
                         [&] { voxel_clustering({}, {.target_size = 3}); });
    test::expect_refused("voxel: expected either a target size or a voxel_size",
                         [&] { voxel_clustering(cloud, {}); });
    test::expect_refused("voxel: expected either a target size or a voxel_size",
                         [&] { voxel_clustering(cloud, {.target_size = 3, .voxel_size = 0.1}); });
    test::expect_refused("target_size 0: expected 1..100",
                         [&] { voxel_clustering(cloud, {.target_size = 0}); });
    for (const double size : {0.0, -1.0, 1e-8, std::nan(""), HUGE_VAL})
        test::expect_refused(": expected a finite number above 0, at least ",
                             [&] { voxel_clustering(cloud, {.voxel_size = size}); });
    test::expect_refused("reductions: no attribute a", [&] {
        voxel_clustering(cloud, {.target_size = 3, .reductions = {{"a", {}}}});
    });
}

}  // namespace
}  // namespace stipple
