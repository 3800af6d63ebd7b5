#include "neighbors/nearby_search.hpp"

#include "neighbors/point_tree.hpp"
#include "neighbors/tree_search.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

namespace stipple {
namespace {

/// A sphere with a spot on it a thousand times as dense, and a few points far away.
std::vector<Vec3f> uneven() {
    std::vector<Vec3f> points = test::sphere(3'000, 0.0).positions;
    for (const Vec3f& p : test::cube(3'000).positions) points.push_back(Vec3f::UnitX() + 0.01F * p);
    for (const Vec3f& p : test::cube(5).positions) points.push_back(50.0F * p);
    return points;
}

TEST(NearbySearch, MissesNothingWithinItsReachFromThinToCrowdedPlacesAndBack) {
    constexpr std::size_t kLeast = 20, kMost = 48;
    const std::vector<Vec3f> points = uneven();
    const PointTree tree(points, PointTree::Leaves::Compact, {});
    NearbySearch search(tree, kLeast, kMost);
    std::size_t crowded = 0;
    for (int i = 0; i < 400; ++i) {
        const float angle = 0.01F * static_cast<float>(i % 100 - 50);  // through the spot
        const Vec3f q(std::cos(angle), std::sin(angle), 0);
        const std::span<const Neighbor> found = search.find(q);
        ASSERT_GE(found.size(), kLeast);
        ASSERT_LE(found.size(), kMost);
        std::set<Index> numbers;
        for (const Neighbor& neighbor : found) {
            numbers.insert(neighbor.index);
            EXPECT_FLOAT_EQ(neighbor.distance_sq, (points[neighbor.index] - q).squaredNorm());
        }
        ASSERT_EQ(numbers.size(), found.size());
        for (std::size_t j = 0; j < points.size(); ++j) {
            const bool is_near = static_cast<double>((points[j] - q).norm()) <= search.reach();
            EXPECT_TRUE(!is_near || numbers.contains(static_cast<Index>(j))) << i << ' ' << j;
        }
        const float radius = 0.05F;  // about that of neighbours where it is thin
        crowded += std::ranges::count_if(
                       points, [&](const Vec3f& p) { return (p - q).norm() <= radius; }) > 600;
    }
    EXPECT_GT(crowded, 10U);
}

TEST(NearbySearch, KnowsWhetherAnyPointIsWithinARadius) {
    const std::vector<Vec3f> points = uneven();
    const PointTree tree(points, PointTree::Leaves::Quick, {});
    for (const Vec3f& q : test::cube(200).positions) {
        Neighbor nearest;
        find_nearest(tree, q, {&nearest, 1});
        EXPECT_TRUE(any_within(tree, q, nearest.distance_sq));
        EXPECT_FALSE(any_within(tree, q, std::nextafter(nearest.distance_sq, 0.0F)));
    }
    EXPECT_FALSE(any_within(PointTree({}, PointTree::Leaves::Quick, {}), Vec3f::Zero(), 1e9F));
}

TEST(NearbySearch, FindsTheNearestFewInACrowd) {
    const std::vector<Vec3f> points = uneven();
    const PointTree tree(points, PointTree::Leaves::Compact, {});
    NearbySearch search(tree, 9, 18);
    for (int i = 0; i < 60; ++i) {
        const Vec3f q = points[static_cast<std::size_t>(i % 2 == 0 ? 40 * i : 3'000 + 40 * i)];
        std::vector<float> expected, found;
        for (const Vec3f& p : points) expected.push_back((p - q).squaredNorm());
        for (const Neighbor& neighbor : search.find_nearest_few(q))
            found.push_back(neighbor.distance_sq);
        std::ranges::sort(expected);
        std::ranges::sort(found);
        ASSERT_EQ(found.size(), 9U);
        for (std::size_t j = 0; j < found.size(); ++j) EXPECT_FLOAT_EQ(found[j], expected[j]);
    }
}

}  // namespace
}  // namespace stipple
