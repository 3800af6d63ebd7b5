#include "neighbors/nearest_kernels.hpp"

#include "analysis/covariance_kernels.hpp"
#include "support/eigen_system.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <numeric>
#include <random>
#include <utility>

namespace stipple {
namespace {

/// Arrays for candidates and answers.
struct Room {
    static constexpr std::uint32_t kLeaves = 64;
    static constexpr std::size_t kSize = 8 * kLeaves + 24;
    std::vector<float> x = std::vector<float>(kSize), y = x, z = x, all = x, distances_sq = x;
    std::vector<std::uint32_t> index = std::vector<std::uint32_t>(kSize), slot = index,
                               rank = index, flipped = index, leaf = index;
    Candidates candidates = {x.data(),   y.data(),    z.data(), index.data(),
                             all.data(), leaf.data(), kLeaves};
    Chosen chosen = {distances_sq.data(), slot.data(), rank.data(), flipped.data()};
};

template <typename T>
std::vector<T> first(const T* from, std::size_t n) {
    return {from, from + n};
}

class Kernels : public testing::TestWithParam<std::size_t> {};

TEST_P(Kernels, ChooseTheSameAsThePlainOnes) {
    const auto all = available_nearest_kernels();
    if (GetParam() >= all.size()) GTEST_SKIP() << "this machine has no more instruction sets";
    const NearestKernels &plain = all.front(), &other = all[GetParam()];
    std::vector<Vec3f> points = test::sphere(3001, 0.02).positions;
    for (Vec3f& p : points) p = (p * 64.0F).array().round() / 64.0F;  // so that many are equal
    const PointTree tree(points, PointTree::Leaves::Quick, {});
    for (std::uint32_t leaf = 0; leaf < tree.leaf_count(); leaf += 3) {
        Room a, b;
        for (const float limit_sq : {0.01F, 0.05F, 1.0F}) {
            const Vec3f low = tree.leaf(leaf).position(0), high = low + Vec3f::Constant(0.05F);
            const bool gathered =
                plain.gather(tree.view(), low.data(), high.data(), limit_sq, a.candidates);
            ASSERT_EQ(other.gather(tree.view(), low.data(), high.data(), limit_sq, b.candidates),
                      gathered);
            if (!gathered) continue;
            ASSERT_EQ(b.candidates.leaves, a.candidates.leaves);
            ASSERT_EQ(b.index, a.index);
            for (const float guess_sq : {0.0F, 0.004F, 1.0F}) {
                for (const std::uint32_t own : {0U, 7U, 9U, PointTree::kNone}) {
                    plain.choose(a.candidates, low.data(), own, 9, 7, guess_sq, a.chosen);
                    other.choose(b.candidates, low.data(), own, 9, 7, guess_sq, b.chosen);
                    ASSERT_EQ(b.chosen.count, a.chosen.count);
                    ASSERT_EQ(b.chosen.radius_sq, a.chosen.radius_sq);
                    const std::size_t n = a.chosen.count;
                    ASSERT_EQ(first(b.chosen.slot, n), first(a.chosen.slot, n));
                    if (n == 0) continue;
                    plain.rank(a.candidates, a.chosen);
                    other.rank(b.candidates, b.chosen);
                    ASSERT_EQ(first(b.chosen.rank, n), first(a.chosen.rank, n));
                }
            }
        }
    }
}

TEST_P(Kernels, FindAllWithinADistance) {
    const auto all = available_nearest_kernels();
    if (GetParam() >= all.size()) GTEST_SKIP() << "this machine has no more instruction sets";
    std::vector<Vec3f> points = test::sphere(3001, 0.02).positions;
    for (Vec3f& p : points) p = (p * 64.0F).array().round() / 64.0F;  // so that many lie at it
    const PointTree tree(points, PointTree::Leaves::Quick, {});
    constexpr std::uint32_t kMost = 100;
    for (const float radius_sq : {0.0F, 0.01F, 0.04F, 0.25F}) {
        const Vec3f q = points[17];
        std::vector<std::pair<Index, float>> expected, found;
        for (Index i = 0; i < points.size(); ++i) {
            const Vec3f d = points[i] - q;
            const float distance_sq = d.x() * d.x() + d.y() * d.y() + d.z() * d.z();
            if (distance_sq <= radius_sq) expected.emplace_back(i, distance_sq);
        }
        std::array<float, kMost + 8> distances_sq;
        std::array<Index, kMost + 8> indices;
        const std::uint32_t count = all[GetParam()].within(tree.view(), q.data(), radius_sq, kMost,
                                                           distances_sq.data(), indices.data());
        std::array<std::array<float, kMost + 8>, 3> ways;
        EXPECT_EQ(all[GetParam()].around(tree.view(), q.data(), radius_sq, kMost, ways[0].data(),
                                         ways[1].data(), ways[2].data()),
                  count);
        if (expected.size() > kMost) {
            EXPECT_GT(count, kMost);
            continue;
        }
        for (std::uint32_t i = 0; i < count; ++i) {
            found.emplace_back(indices[i], distances_sq[i]);
            EXPECT_EQ(q + Vec3f(ways[0][i], ways[1][i], ways[2][i]), points[indices[i]]);
        }
        std::ranges::sort(found);
        EXPECT_EQ(found, expected) << radius_sq;
    }
}

/// The first eight of many points in one place, seen from afar, of a tree whose other leaves say
/// that their points are nearer than their boxes do: so they are seen to be looked at.
TEST_P(Kernels, LookAtNoMoreOfACrowdThanIsAskedFor) {
    const auto all = available_nearest_kernels();
    if (GetParam() >= all.size()) GTEST_SKIP() << "this machine has no more instruction sets";
    constexpr std::uint32_t kAsked = 8;
    const Vec3f place(1, 2, 3);
    const PointTree tree(std::vector<Vec3f>(5'000, place), PointTree::Leaves::Quick, {});
    std::vector<PointTree::Leaf> leaves;
    for (std::size_t l = 0; l < tree.leaf_count(); ++l) leaves.push_back(tree.leaf(l));
    for (const Vec3f& q : {Vec3f(1, 2, 3), Vec3f(0, 0, 0)}) {
        for (std::size_t l = 1; l < leaves.size(); ++l) {
            leaves[l].x.fill(q.x());
            leaves[l].y.fill(q.y());
            leaves[l].z.fill(q.z());
            leaves[l].index.fill(0);
        }
        PointTree::View view = tree.view();
        view.leaves = leaves.data();
        std::array<std::int64_t, 1 + kAsked + 3> room;
        std::int64_t* const keys = room.data() + 1;
        ASSERT_TRUE(all[GetParam()].nearest(view, q.data(), kAsked, keys));
        for (std::uint32_t i = 0; i < kAsked; ++i) {
            EXPECT_EQ(static_cast<Index>(keys[i]), i);
            const auto bits =
                static_cast<std::uint32_t>(static_cast<std::uint64_t>(keys[i]) >> 32U);
            EXPECT_EQ(std::bit_cast<float>(bits), (place - q).squaredNorm());
        }
    }
}

TEST_P(Kernels, TellHowFarTheEightNearestAlongTheCurveLie) {
    const auto all = available_nearest_kernels();
    if (GetParam() >= all.size()) GTEST_SKIP() << "this machine has no more instruction sets";
    for (const std::size_t n : {1U, 5U, 8U, 9U, 16U, 19U, 203U}) {
        const PointTree tree(test::sphere(n, 0.02).positions, PointTree::Leaves::Quick, {});
        const std::size_t leaves = tree.leaf_count();
        for (std::size_t l = 0; l < leaves; ++l) {
            std::array<float, PointTree::kWidth> plain, found;
            all.front().spread(tree.view(), static_cast<std::uint32_t>(l), plain.data());
            all[GetParam()].spread(tree.view(), static_cast<std::uint32_t>(l), found.data());
            // Three leaves, but where there are no more.
            const std::size_t first = leaves < 3 ? 0 : std::min(l > 0 ? l - 1 : 0, leaves - 3);
            for (std::size_t lane = 0; lane < tree.points_in(l); ++lane) {
                EXPECT_EQ(found[lane], plain[lane]);
                std::vector<float> others;
                for (std::size_t at = 8 * first; at < std::min(8 * (first + 3), n); ++at)
                    if (at != 8 * l + lane)
                        others.push_back(
                            (tree.leaf(at / 8).position(at % 8) - tree.leaf(l).position(lane))
                                .squaredNorm());
                std::ranges::sort(others);
                others.resize(std::min<std::size_t>(8, others.size()));
                const float sum = std::accumulate(others.begin(), others.end(), 0.0F);
                EXPECT_NEAR(found[lane], sum / 8, 1e-5F * sum) << n << ' ' << l << ' ' << lane;
            }
        }
    }
}

/// Matrices with eigenvalues far apart, close, equal and zero.
EigenProblems some_problems(std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> entry(-1, 1);
    EigenProblems problems{};
    for (std::size_t lane = 0; lane < 8; ++lane) {
        const Eigen::Matrix3d q =
            Eigen::Quaterniond(entry(random), entry(random), entry(random), entry(random))
                .normalized()
                .toRotationMatrix();
        Vec3d lambda = {std::abs(entry(random)), std::abs(entry(random)), std::abs(entry(random))};
        if (lane == 1) lambda = {1, 1 + 1e-9, 1};
        if (lane == 2) lambda = {0, 1e-12, 1};
        if (lane == 3) lambda = {0, 0, 1};
        if (lane == 4) lambda = {0, 0, 0};
        if (lane == 5) lambda *= 1e-40;
        if (lane == 6) lambda *= 1e40;
        if (lane == 7) lambda = {0.5, 0.5, 0.5 + 1e-14};
        const Eigen::Matrix3d m = q * lambda.asDiagonal() * q.transpose();
        problems.xx[lane] = m(0, 0);
        problems.yy[lane] = m(1, 1);
        problems.zz[lane] = m(2, 2);
        problems.xy[lane] = m(0, 1);
        problems.yz[lane] = m(1, 2);
        problems.zx[lane] = m(2, 0);
    }
    return problems;
}

TEST_P(Kernels, SolveEigenproblems) {
    const auto all = available_covariance_kernels();
    if (GetParam() >= all.size()) GTEST_SKIP() << "this machine has no more instruction sets";
    for (std::uint64_t seed = 0; seed < 200; ++seed) {
        const EigenProblems given = some_problems(seed);
        EigenProblems solved = given, plain = given;
        all[GetParam()].solve(solved);
        all.front().solve(plain);
        ASSERT_EQ(std::memcmp(&solved, &plain, sizeof plain), 0);
        for (std::size_t lane = 0; lane < 8; ++lane) {
            Eigen::Matrix3d m;
            m << given.xx[lane], given.xy[lane], given.zx[lane], given.xy[lane], given.yy[lane],
                given.yz[lane], given.zx[lane], given.yz[lane], given.zz[lane];
            const Vec3d expected = test::eigen_system(m).values;
            const double scale = m.norm();
            ASSERT_NEAR(solved.low[lane], expected[0], 1e-14 * scale);
            ASSERT_NEAR(solved.middle[lane], expected[1], 1e-14 * scale);
            ASSERT_NEAR(solved.high[lane], expected[2], 1e-14 * scale);
            const Vec3d v = {solved.x[lane], solved.y[lane], solved.z[lane]};
            ASSERT_NEAR(v.norm(), 1.0, 1e-14);
            ASSERT_LE((m * v - solved.low[lane] * v).norm(), 1e-14 * scale);
        }
    }
}

TEST_P(Kernels, AddMomentsToTheSameBits) {
    const auto all = available_covariance_kernels();
    if (GetParam() >= all.size()) GTEST_SKIP() << "this machine has no more instruction sets";
    Room room;
    const std::vector<Vec3f> points = test::cube(100).positions;
    for (std::uint32_t i = 0; i < points.size(); ++i) {
        room.x[i] = points[i].x();
        room.y[i] = points[i].y();
        room.z[i] = points[i].z();
        room.slot[i] = 99 - i;
    }
    const float reference[3] = {0.25F, 0.5F, 0.75F};
    Moments plain, other;
    all.front().add_moments(room.candidates, room.slot.data(), 100, reference, plain);
    all[GetParam()].add_moments(room.candidates, room.slot.data(), 100, reference, other);
    EXPECT_EQ(std::memcmp(&plain, &other, sizeof plain), 0);

    Vec3d sum = Vec3d::Zero(), squares = Vec3d::Zero(), products = Vec3d::Zero();
    for (const Vec3f& p : points) {
        const Vec3d d = p.cast<double>() - Vec3d(0.25, 0.5, 0.75);
        sum += d;
        squares += d.cwiseProduct(d);
        products += Vec3d(d.x() * d.y(), d.y() * d.z(), d.z() * d.x());
    }
    for (int axis = 0; axis < 3; ++axis) {
        EXPECT_NEAR(plain.sum[axis], sum[axis], 1e-12);
        EXPECT_NEAR(plain.squares[axis], squares[axis], 1e-12);
        EXPECT_NEAR(plain.products[axis], products[axis], 1e-12);
    }
}

INSTANTIATE_TEST_SUITE_P(InstructionSets, Kernels, testing::Values(0U, 1U));

}  // namespace
}  // namespace stipple
