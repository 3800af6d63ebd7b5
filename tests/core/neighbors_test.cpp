#include "stipple/neighbors.hpp"

#include "stipple/cleaning.hpp"
#include "stipple/codec.hpp"
#include "support/expect_error.hpp"
#include "support/oracles.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <limits>
#include <nanoflann.hpp>

namespace stipple {
namespace {

using test::sorted_distances;

/// Every list against all pairs.
void expect_exact(const std::vector<Vec3f>& points, unsigned k) {
    const NeighborLists lists = k_nearest_neighbors(points, k);
    ASSERT_EQ(lists.size(), points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
        const auto expected = sorted_distances(points, i);
        const std::span<const Index> found = lists.of(i);
        ASSERT_EQ(found.size(), std::min<std::size_t>(k, points.size() - 1));
        for (std::size_t j = 0; j < found.size(); ++j) {
            ASSERT_EQ(found[j], expected[j].second) << "point " << i << ", neighbour " << j;
            ASSERT_EQ(lists.distances_sq[lists.offsets[i] + j], expected[j].first);
        }
    }
}

std::vector<Vec3f> lattice(int side) {
    std::vector<Vec3f> points;
    for (int x = 0; x < side; ++x) {
        for (int y = 0; y < side; ++y) {
            for (int z = 0; z < side; ++z) points.emplace_back(x, y, z);
        }
    }
    return points;
}

class NearestNeighbors : public testing::TestWithParam<unsigned> {};

TEST_P(NearestNeighbors, AreThoseOfAllPairsOnASurface) {
    expect_exact(test::sphere(1500, 0.05).positions, GetParam());
}
TEST_P(NearestNeighbors, AreThoseOfAllPairsInAVolume) {
    expect_exact(test::cube(1200).positions, GetParam());
}
TEST_P(NearestNeighbors, AreThoseOfAllPairsOnALine) {
    expect_exact(test::line(700).positions, GetParam());
}
TEST_P(NearestNeighbors, AreThoseOfTheSmallerIndexAmongEquals) {
    expect_exact(lattice(9), GetParam());
}
TEST_P(NearestNeighbors, AreFoundAmongEqualPoints) {
    expect_exact(std::vector<Vec3f>(300, Vec3f(1, 2, 3)), GetParam());
}
TEST_P(NearestNeighbors, AreAllOthersInATinyCloud) {
    for (std::size_t n = 1; n < 20; ++n) expect_exact(test::cube(n).positions, GetParam());
}
TEST_P(NearestNeighbors, AreFoundAcrossDensitiesAndOutliers) {
    std::vector<Vec3f> points = test::cube(600).positions;
    for (const Vec3f& p : test::cube(600, 2).positions)
        points.push_back(p * 1e-6F + Vec3f(100, 0, 0));
    for (const Vec3f& p : test::cube(5, 3).positions) points.push_back(p * 1e18F);
    expect_exact(points, GetParam());
}
TEST_P(NearestNeighbors, AreFoundWhereSquaredDistancesUnderflowOrOverflow) {
    std::vector<Vec3f> points;
    for (const Vec3f& p : test::cube(100).positions) points.push_back(p * 1e-22F);
    for (const Vec3f& p : test::cube(40, 2).positions) points.push_back(p * 3e38F);
    expect_exact(points, GetParam());
}

INSTANTIATE_TEST_SUITE_P(K, NearestNeighbors, testing::Values(1U, 2U, 7U, 16U, 33U, 250U));

TEST(NearestNeighbors, OfNoPointsAreNone) {
    EXPECT_EQ(k_nearest_neighbors({}, 3).size(), 0U);
}

TEST(NearestNeighbors, RefuseZeroNeighbors) {
    test::expect_refused("k 0: expected at least 1 neighbour",
                         [&] { k_nearest_neighbors(test::cube(3).positions, 0); });
}

TEST(NearestNeighbors, AreTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::sphere(20'000, 0.01);
    const NeighborLists one = k_nearest_neighbors(cloud.positions, 16, {.threads = 1});
    const NeighborLists eight = k_nearest_neighbors(cloud.positions, 16, {.threads = 8});
    EXPECT_EQ(one.indices, eight.indices);
    EXPECT_EQ(one.distances_sq, eight.distances_sq);
}

struct NanoflannCloud {
    const std::vector<Vec3f>& points;
    std::size_t kdtree_get_point_count() const { return points.size(); }
    float kdtree_get_pt(std::size_t i, std::size_t axis) const {
        return points[i][static_cast<Eigen::Index>(axis)];
    }
    template <typename Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }
};

TEST(NearestNeighbors, AgreeWithNanoflannOnARealScan) {
    const auto file = test::shared_file("raw/detergent.ply");
    if (!file) GTEST_SKIP() << "the shared scans are not here";
    PointCloud cloud = read_cloud(*file);
    clean(cloud);
    constexpr unsigned k = 16;
    const NeighborLists lists = k_nearest_neighbors(cloud.positions, k);

    const NanoflannCloud adaptor{cloud.positions};
    using Tree =
        nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, NanoflannCloud>,
                                            NanoflannCloud, 3, Index>;
    Tree tree(3, adaptor, nanoflann::KDTreeSingleIndexAdaptorParams(10));
    tree.buildIndex();
    std::vector<Index> indices(k + 1);
    std::vector<float> distances(k + 1);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        tree.knnSearch(cloud.positions[i].data(), k + 1, indices.data(), distances.data());
        for (unsigned j = 0; j < k; ++j)
            ASSERT_EQ(lists.distances_sq[lists.offsets[i] + j], distances[j + 1]);
    }
}

TEST(RadiusNeighbors, AreThoseOfAllPairs) {
    for (const auto& points :
         {test::sphere(900, 0.1).positions, lattice(8), test::line(300).positions}) {
        const float radius = 1.0F;  // on the lattice: neighbours at exactly the radius count
        const NeighborLists lists = radius_neighbors(points, radius);
        for (std::size_t i = 0; i < points.size(); ++i) {
            std::vector<Index> expected;
            for (const auto& [distance_sq, index] : sorted_distances(points, i)) {
                if (distance_sq <= radius * radius) expected.push_back(index);
            }
            ASSERT_EQ(std::vector<Index>(lists.of(i).begin(), lists.of(i).end()), expected);
        }
    }
}

TEST(RadiusNeighbors, RefuseARadiusThatIsNone) {
    for (const float radius : {0.0F, -1.0F, NAN, INFINITY}) {
        test::expect_refused(": expected a finite length above 0",
                             [&] { radius_neighbors(test::cube(3).positions, radius); });
    }
}

TEST(MeanSpacing, IsTheStepOfALattice) {
    EXPECT_DOUBLE_EQ(mean_spacing(lattice(7)), 1.0);
}
TEST(MeanSpacing, IsNotThatOfOnePointFarOff) {
    std::vector<Vec3f> points = lattice(20);
    points.emplace_back(0, 0, 1e6F);
    EXPECT_NEAR(mean_spacing(points), 1.0, 0.05);
}
TEST(MeanSpacing, IsZeroForASinglePoint) {
    EXPECT_EQ(mean_spacing(test::cube(1).positions), 0.0);
}
TEST(MeanSpacing, OfALargeCloudIsThatOfAllItsPointsWithinOnePercent) {
    const PointCloud cloud = test::cube(300'000);
    const NeighborLists all = k_nearest_neighbors(cloud.positions, 1);
    double sum = 0;
    for (const float sq : all.distances_sq) sum += std::sqrt(static_cast<double>(sq));
    const double exact = sum / static_cast<double>(cloud.size());
    EXPECT_NEAR(mean_spacing(cloud.positions) / exact, 1.0, 0.01);
}

TEST(NearestNeighbors, RefuseAnInfiniteCoordinate) {
    std::vector<Vec3f> points = test::sphere(200).positions;
    points[7].y() = std::numeric_limits<float>::infinity();
    test::expect_refused(
        "positions: expected finite coordinates; remove the points that have others",
        [&] { k_nearest_neighbors(points, 8); });
}

}  // namespace
}  // namespace stipple
