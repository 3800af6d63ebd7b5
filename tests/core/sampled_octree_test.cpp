#include "stipple/sampled_octree.hpp"

#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <numeric>
#include <set>

namespace stipple {
namespace {

using Position = SampledOctree::Position;

/// Around a cloud about the size of 1.
OctreeCube cube_of_ten_bits() {
    return {Vec3d::Constant(-2), 4.0 / 1024, 10};
}

TEST(SampledOctree, HasEveryPointInOneNodeAndParentsFirst) {
    const PointCloud cloud = test::sphere(20'000);
    const SampledOctree octree(cloud, cube_of_ten_bits(), {.grid = 8, .max_points = 100});
    std::vector<Index> order(octree.order().begin(), octree.order().end());
    std::ranges::sort(order);
    std::vector<Index> all(cloud.size());
    std::iota(all.begin(), all.end(), Index{0});
    EXPECT_EQ(order, all);
    std::uint32_t next = 0;
    std::set<std::int32_t> children;
    for (std::size_t n = 0; n < octree.nodes().size(); ++n) {
        const SampledOctree::Node& node = octree.nodes()[n];
        EXPECT_EQ(node.first, next);
        EXPECT_GT(node.count, 0U);
        next += node.count;
        for (const std::int32_t child : node.children) {
            if (child < 0) continue;
            EXPECT_GT(child, static_cast<std::int32_t>(n));
            EXPECT_TRUE(children.insert(child).second);
            EXPECT_EQ(octree.nodes()[static_cast<std::size_t>(child)].depth, node.depth + 1);
        }
    }
    EXPECT_EQ(next, cloud.size());
    EXPECT_EQ(children.size() + 1, octree.nodes().size());
}

TEST(SampledOctree, KeepsInTheCubeOfANodeThePointsNearestToTheMiddlesOfItsCells) {
    const PointCloud cloud = test::sphere(20'000);
    const OctreeCube cube = cube_of_ten_bits();
    const unsigned grid = 8;
    const SampledOctree octree(cloud, cube, {.grid = grid, .max_points = 100});
    const auto points_from = [&](const SampledOctree::Node& node) {
        return octree.positions().subspan(node.first, node.count);
    };
    const auto place_in = [&](const SampledOctree::Node& node, const Position& p) {
        Vec3d place;  // in cells
        for (int axis = 0; axis < 3; ++axis) {
            const double side = std::ldexp(1.0, static_cast<int>(cube.bits - node.depth));
            place[axis] = (p[axis] + 0.5 - node.place[axis] * side) / side * grid;
        }
        return place;
    };
    // A cell's own point is no farther from its middle than any below it.
    const auto check = [&](auto&& self, const SampledOctree::Node& node,
                           const SampledOctree::Node& below) -> void {
        for (const std::int32_t child : below.children)
            if (child >= 0) self(self, node, octree.nodes()[static_cast<std::size_t>(child)]);
        if (&node == &below) return;
        const auto off = [](const Vec3d& p) {
            return (p.array() - p.array().floor() - 0.5).matrix().norm();
        };
        for (const Position& p : points_from(below)) {
            const Vec3d place = place_in(node, p);
            EXPECT_TRUE((place.array() >= 0).all() && (place.array() < grid).all());
            const bool has_better = std::ranges::any_of(points_from(node), [&](const Position& q) {
                const Vec3d other = place_in(node, q);
                return other.array().floor().isApprox(place.array().floor()) &&
                       off(other) <= off(place) + 1e-12;
            });
            EXPECT_TRUE(has_better);
        }
    };
    const SampledOctree::Node& root = octree.nodes().front();
    check(check, root, root);
    const std::int32_t child = *std::ranges::find_if(root.children, [](auto c) { return c >= 0; });
    const auto& some = octree.nodes()[static_cast<std::size_t>(child)];
    check(check, some, some);
}

TEST(SampledOctree, IsTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::sphere(30'000);
    const auto made = [&](unsigned threads) {
        RunContext context;
        context.threads = threads;
        const SampledOctree octree(cloud, cube_of_ten_bits(), {.max_points = 500}, context);
        return std::vector<Index>(octree.order().begin(), octree.order().end());
    };
    EXPECT_EQ(made(1), made(4));
}

TEST(SampledOctree, EndsWherePointsCoincideAndAtTheBordersOfItsCube) {
    PointCloud cloud;
    cloud.positions.assign(500, Vec3f(0.1F, 0.2F, 0.3F));
    cloud.positions.insert(cloud.positions.end(), 10, Vec3f(9, 9, 9));
    const SampledOctree octree(cloud, cube_of_ten_bits(), {.grid = 2, .max_points = 1});
    EXPECT_EQ(octree.order().size(), 510U);
    for (const SampledOctree::Node& node : octree.nodes()) EXPECT_LE(node.depth, 10U);
    const SampledOctree shallow(cloud, cube_of_ten_bits(), {.max_points = 1, .max_depth = 3});
    for (const SampledOctree::Node& node : shallow.nodes()) EXPECT_LE(node.depth, 3U);
    for (const Position& p : octree.positions())
        for (const std::int32_t x : p) EXPECT_LT(x, 1024);
}

TEST(SampledOctree, RefusesWhatItCannotDo) {
    const PointCloud cloud = test::sphere(10);
    test::expect_refused("the cloud has no points", [&] { SampledOctree({}, cube_of_ten_bits()); });
    test::expect_refused("grid 1: expected 2..256",
                         [&] { SampledOctree(cloud, cube_of_ten_bits(), {.grid = 1}); });
    test::expect_refused("grid 257: expected 2..256",
                         [&] { SampledOctree(cloud, cube_of_ten_bits(), {.grid = 257}); });
    test::expect_refused("max_points 0: expected at least 1",
                         [&] { SampledOctree(cloud, cube_of_ten_bits(), {.max_points = 0}); });
    for (const double step : {0.0, -1.0, std::nan(""), HUGE_VAL})
        test::expect_refused("step of the cube", [&] {
            SampledOctree(cloud, {.low = Vec3d::Zero(), .step = step, .bits = 10});
        });
    for (const unsigned bits : {0U, 31U})
        test::expect_refused("bits of the cube", [&] {
            SampledOctree(cloud, {.low = Vec3d::Zero(), .step = 1, .bits = bits});
        });
}

}  // namespace
}  // namespace stipple
