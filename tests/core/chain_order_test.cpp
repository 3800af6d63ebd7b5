#include "cloud/chain_order.hpp"

#include "base/kernel_sets.hpp"
#include "base/random.hpp"
#include "cloud/hilbert_order.hpp"
#include "stipple/codec.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <set>

namespace stipple {
namespace {

double length_of(std::span<const GridPoint> points, std::span<const Index> order) {
    double length = 0;
    for (std::size_t i = 1; i < order.size(); ++i) {
        double squared = 0;
        for (std::size_t axis = 0; axis < 3; ++axis)
            squared += std::pow(points[order[i]][axis] - points[order[i - 1]][axis], 2);
        length += std::sqrt(squared);
    }
    return length;
}

/// In the order of a curve.
std::vector<GridPoint> on_grid(const PointCloud& cloud, float steps) {
    std::vector<GridPoint> points;
    for (const Index i : hilbert_order(cloud.positions, {})) {
        const Vec3f q = steps * (0.5F * cloud.positions[i] + Vec3f::Constant(0.5F));
        points.push_back({static_cast<std::uint16_t>(q.x()), static_cast<std::uint16_t>(q.y()),
                          static_cast<std::uint16_t>(q.z())});
    }
    return points;
}

TEST(ChainOrder, VisitsEveryPointOnce) {
    for (const std::size_t count : {1, 2, 127, 128, 129, 3'000, 10'003}) {
        for (const float steps : {0.0F, 3.0F, 255.0F, 65'535.0F}) {
            const auto points = on_grid(test::sphere(count), steps);
            std::vector<Index> order = chain_order(points);
            ASSERT_EQ(order.size(), count);
            std::ranges::sort(order);
            for (Index i = 0; i < points.size(); ++i) ASSERT_EQ(order[i], i);
        }
    }
    EXPECT_TRUE(chain_order({}).empty());
}

std::vector<Index> chain_order_by_blocks(std::span<const GridPoint> points) {
    BlockChain chain;
    const std::span<const Index> order = chain.order(points);
    return {order.begin(), order.end()};
}

TEST(ChainOrder, ByBlocksVisitsEveryPointOnceAndEveryBlockOnce) {
    for (const float steps : {200.0F, 1'000.0F, 65'535.0F}) {
        const auto points = on_grid(test::sphere(3'000), steps);
        const std::vector<Index> order = chain_order_by_blocks(points);
        EXPECT_EQ(std::set<Index>(order.begin(), order.end()).size(), points.size());
        std::vector<GridPoint> blocks;
        for (const Index i : order)
            blocks.push_back({static_cast<std::uint16_t>(points[i][0] / 256),
                              static_cast<std::uint16_t>(points[i][1] / 256),
                              static_cast<std::uint16_t>(points[i][2] / 256)});
        const std::size_t there_are = std::set(blocks.begin(), blocks.end()).size();
        blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
        EXPECT_EQ(blocks.size(), there_are);
    }
    EXPECT_TRUE(chain_order_by_blocks({}).empty());
}

TEST(ChainOrder, OfATileDoesNotDependOnTheTileBefore) {
    BlockChain chain;
    for (const std::size_t count : {3'000, 100, 9'000, 0}) {
        const auto points = on_grid(test::sphere(count), 2'000);
        EXPECT_TRUE(std::ranges::equal(chain.order(points), chain_order_by_blocks(points)));
    }
}

TEST(ChainOrder, IsTheSameOnEveryMachine) {
    for (const float steps : {255.0F, 2'000.0F, 30'000.0F}) {
        const auto points = on_grid(test::sphere(9'001), steps);
        const std::vector<Index> quickest = chain_order(points);
        const std::vector<Index> quickest_by_blocks = chain_order_by_blocks(points);
        const PlainKernelsOnly plain;
        EXPECT_EQ(chain_order(points), quickest);
        EXPECT_EQ(chain_order_by_blocks(points), quickest_by_blocks);
    }
}

TEST(ChainOrder, ByBlocksGoesToTheNearestOfTheNext128) {
    for (const float steps : {255.0F, 2'000.0F, 30'000.0F}) {  // many of a block, some, one
        // Block by block already, so that the next are the next along the curve.
        auto points = on_grid(test::sphere(3'000), steps);
        const auto block_of = [](const GridPoint& p) {
            return GridPoint{static_cast<std::uint16_t>(p[0] / 256),
                             static_cast<std::uint16_t>(p[1] / 256),
                             static_cast<std::uint16_t>(p[2] / 256)};
        };
        std::ranges::stable_sort(points, {}, block_of);
        const auto distance = [&](const GridPoint& a, const GridPoint& b) {
            int sum = 0;
            for (std::size_t axis = 0; axis < 3; ++axis)
                sum += std::abs((a[axis] + 1'024 * (a[axis] / 256)) -
                                (b[axis] + 1'024 * (b[axis] / 256)));
            return sum;
        };
        const std::vector<Index> order = chain_order_by_blocks(points);
        std::set<Index> left;  // of those that may come next
        Index next = 0;
        for (std::size_t i = 0; i < order.size(); ++i) {
            while (left.size() < 128 && next < points.size()) left.insert(next++);
            if (i > 0) {
                int least = std::numeric_limits<int>::max();
                for (const Index other : left)
                    least = std::min(least, distance(points[other], points[order[i - 1]]));
                ASSERT_EQ(distance(points[order[i]], points[order[i - 1]]), least) << i;
            }
            ASSERT_EQ(left.erase(order[i]), 1U);
        }
    }
}

/// Points of a sphere with colours in two fields and noise.
PointCloud colored_sphere(std::size_t count) {
    PointCloud cloud = test::sphere(count, 0.01);
    std::uint64_t drawn = 0;
    for (const Vec3f& p : cloud.positions) {
        const bool light = std::sin(60 * p.x()) + std::sin(50 * p.y()) > 0;
        const auto channel = [&] {
            return static_cast<std::uint8_t>((light ? 180 : 40) + random_bits(7, drawn++) % 10);
        };
        cloud.colors.push_back({channel(), channel(), channel(), 255});
    }
    return cloud;
}

TEST(ChainOrder, WithColorsVisitsEveryPointOnceTheSameForAllThreadsAndMachines) {
    for (const std::size_t count : {1, 2, 255, 256, 257, 3'000, 70'000}) {
        const PointCloud cloud = colored_sphere(count);
        const auto order_on = [&](unsigned threads) {
            return chain_through(cloud.positions, 1e-4, cloud.colors, {.threads = threads});
        };
        const std::vector<Index> order = order_on(1);
        EXPECT_EQ(order_on(3), order);
        {
            const PlainKernelsOnly plain;
            EXPECT_EQ(order_on(1), order);
        }
        EXPECT_EQ(std::set<Index>(order.begin(), order.end()).size(), count);
        EXPECT_EQ(order.size(), count);
    }
}

TEST(ChainOrder, WithColorsGoesToTheCheapestOfTheNext256) {
    const PointCloud cloud = colored_sphere(2'000);
    constexpr double kStep = 1e-3;
    const std::vector<Index> curve = hilbert_order(cloud.positions, {});
    const std::vector<Index> order = chain_through(cloud.positions, kStep, cloud.colors, {});
    const auto bits = [&](Index a, Index b) {
        const Vec3d d = (cloud.positions[a] - cloud.positions[b]).cast<double>() / kStep;
        const Rgba8 &p = cloud.colors[a], &q = cloud.colors[b];
        const int change = std::abs(p.r - q.r) + std::abs(p.g - q.g) + std::abs(p.b - q.b);
        return std::log2(1 + d.cwiseAbs().sum()) + std::log2(1 + change);
    };
    std::set<Index> left;
    std::size_t next = 0;
    for (std::size_t i = 0; i < order.size(); ++i) {
        while (left.size() < 256 && next < curve.size()) left.insert(curve[next++]);
        if (i > 0) {
            double least = 1e30;
            for (const Index other : left) least = std::min(least, bits(other, order[i - 1]));
            ASSERT_NEAR(bits(order[i], order[i - 1]), least, 1e-3) << i;
        }
        ASSERT_EQ(left.erase(order[i]), 1U);
    }
}

TEST(ChainOrder, WithColorsMakesDracoFilesSmallerThanByTheNearest) {
    const PointCloud cloud = colored_sphere(20'000);
    DracoEncodeOptions options;
    options.coding = DracoCoding::Sequential;
    const PointCloud by_nearest = subset(cloud, chain_through(cloud.positions, {}));
    const std::size_t nearest = encode_draco(by_nearest, options).size();
    options.coding = DracoCoding::Auto;
    EXPECT_LT(static_cast<double>(encode_draco(cloud, options).size()),
              0.98 * static_cast<double>(nearest));
}

TEST(ChainOrder, GoesToTheNearestOfThoseThatComeNext) {
    std::vector<GridPoint> line;
    for (unsigned i = 0; i < 1'000; ++i) line.push_back({static_cast<std::uint16_t>(13 * i), 7, 7});
    for (std::size_t begin = 0; begin < line.size(); begin += 100)
        std::ranges::reverse(std::span(line).subspan(begin + 1, 99));
    EXPECT_EQ(length_of(line, chain_order(line)), 13.0 * 999);
}

TEST(ChainOrder, IsAboutAsShortAsAChainToTheNearestOfAll) {
    const auto points = on_grid(test::sphere(2'000), 65'535);
    const std::vector<Index> order = chain_order(points);
    // By exhaustive search, from the same point.
    std::vector<bool> visited(points.size());
    std::vector<Index> exhaustive{order.front()};
    visited[order.front()] = true;
    while (exhaustive.size() < points.size()) {
        double best = 1e30;
        Index next = 0;
        for (Index i = 0; i < points.size(); ++i) {
            if (visited[i]) continue;
            double squared = 0;
            for (std::size_t axis = 0; axis < 3; ++axis)
                squared += std::pow(points[i][axis] - points[exhaustive.back()][axis], 2);
            if (squared < best) {
                best = squared;
                next = i;
            }
        }
        visited[next] = true;
        exhaustive.push_back(next);
    }
    EXPECT_LE(length_of(points, order), 1.15 * length_of(points, exhaustive));
}

}  // namespace
}  // namespace stipple
