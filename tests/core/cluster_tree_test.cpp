#include "clustering/cluster_tree.hpp"

#include "clustering/large_split.hpp"
#include "stipple/error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <numeric>
#include <stop_token>

namespace stipple {
namespace {

std::vector<Index> numbers_to(std::size_t n) {
    std::vector<Index> numbers(n);
    std::iota(numbers.begin(), numbers.end(), Index{0});
    return numbers;
}

TEST(ClusterTree, ACutDoesNotDependOnTheCutsBefore) {
    const auto points = test::sphere(20'000, 0.05).positions;
    ClusterTree fine_first(points), coarse_first(points), alone(points);
    const Cut fine = fine_first.cut(3000, {});
    EXPECT_EQ(fine_first.cut(100, {}).offsets, alone.cut(100, {}).offsets);
    coarse_first.cut(100, {});
    coarse_first.cut(9000, {});
    EXPECT_EQ(coarse_first.cut(3000, {}).offsets, fine.offsets);
    // The clusters hold the same points; within one their order is that of the deepest split.
    for (std::size_t i = 0; i + 1 < fine.offsets.size(); ++i) {
        std::vector<Index> a(fine_first.members().begin() + fine.offsets[i],
                             fine_first.members().begin() + fine.offsets[i + 1]);
        std::vector<Index> b(coarse_first.members().begin() + fine.offsets[i],
                             coarse_first.members().begin() + fine.offsets[i + 1]);
        std::ranges::sort(a);
        std::ranges::sort(b);
        EXPECT_EQ(a, b);
    }
}

TEST(ClusterTree, CutsOfSeveralSizesAreThoseOfEachAlone) {
    const auto points = test::sphere(20'000, 0.05).positions;
    constexpr std::array<std::uint64_t, 6> kSizes = {20'000, 9'000, 3'000, 3'000, 2, 1};
    const std::vector<Cut> cuts = ClusterTree(points).cuts(kSizes, {});
    ASSERT_EQ(cuts.size(), kSizes.size());
    for (std::size_t i = 0; i < kSizes.size(); ++i) {
        const Cut alone = ClusterTree(points).cut(kSizes[i], {});
        EXPECT_EQ(cuts[i].offsets, alone.offsets) << kSizes[i];
        EXPECT_EQ(cuts[i].clusters_of, alone.clusters_of) << kSizes[i];
    }
}

TEST(ClusterTree, ACutSaysHowItsClustersHangTogether) {
    const auto points = test::sphere(5000, 0.05).positions;
    ClusterTree tree(points);
    const Cut cut = tree.cut(77, {});
    ASSERT_EQ(cut.offsets.size(), 78U);
    ASSERT_EQ(cut.clusters_of.size(), 2 * 77U - 1);
    EXPECT_EQ(cut.clusters_of.front(), 77U);
    for (std::size_t i = 0; i < cut.clusters_of.size(); ++i) {
        if (cut.clusters_of[i] == 1) continue;
        const std::size_t right = i + 2 * std::size_t{cut.clusters_of[i + 1]};
        EXPECT_EQ(cut.clusters_of[i], cut.clusters_of[i + 1] + cut.clusters_of[right]);
    }
}

TEST(ClusterTree, SplitsLargeCloudsAlikeOnAnyNumberOfThreads) {
    const auto points = test::sphere(600'000, 0.01).positions;
    ClusterTree one(points), eight(points);
    EXPECT_EQ(one.cut(200, {.threads = 1}).offsets, eight.cut(200, {.threads = 8}).offsets);
    EXPECT_TRUE(std::ranges::equal(one.members(), eight.members()));
    std::vector<Index> members(one.members().begin(), one.members().end());
    std::ranges::sort(members);
    EXPECT_EQ(members, numbers_to(points.size()));
}

TEST(ClusterTree, CutsOfALargeCloudAreThoseOfEachAlone) {
    const auto points = test::sphere(600'000, 0.01).positions;
    constexpr std::array<std::uint64_t, 2> kSizes = {150'000, 500};
    const std::vector<Cut> cuts = ClusterTree(points).cuts(kSizes, {});
    for (std::size_t i = 0; i < kSizes.size(); ++i)
        EXPECT_EQ(cuts[i].offsets, ClusterTree(points).cut(kSizes[i], {}).offsets) << kSizes[i];
}

TEST(ClusterTree, TellsHowFarItIs) {
    const std::vector<Vec3f> points =
        test::sphere(600'000).positions;  // more than are split at once
    std::vector<double> told;
    // On one thread: of several, the calling one alone tells.
    const RunContext context{.progress = [&](double fraction) { told.push_back(fraction); },
                             .threads = 1};
    ClusterTree(points).cut(10'000, context);
    EXPECT_TRUE(std::ranges::is_sorted(told));
    EXPECT_LT(told.front(), 0.1);
    EXPECT_GT(told.back(), 0.9);
    std::vector<double> steps(told.size());
    std::adjacent_difference(told.begin(), told.end(), steps.begin());
    EXPECT_LT(std::ranges::max(steps), 0.4);
}

TEST(ClusterTree, HalvesWhatRoundingLeavesOnOneSide) {
    // Squares of these coordinates overflow: no plane is to be had.
    std::vector<Vec3f> points;
    for (int i = 0; i < 300; ++i) points.emplace_back(1e30F * static_cast<float>(i - 150), 0, 0);
    ClusterTree tree(points);
    const Cut cut = tree.cut(300, {});
    EXPECT_EQ(cut.offsets, numbers_to(301));
}

TEST(ClusterTree, SplitsTwoThatAreFarApartAlike) {
    // 300,000 points each, so that both ways of taking moments have to do with them; and 2,000.
    for (const std::size_t half : {2'000U, 300'000U}) {
        std::vector<Vec3f> points = test::sphere(half).positions;
        for (std::size_t i = 0; i < half; ++i) points.emplace_back(points[i] + Vec3f(1e5F, 0, 0));
        ClusterTree tree(points);
        const Cut cut = tree.cut(200, {});
        std::size_t near = 0;
        for (std::size_t i = 0; i + 1 < cut.offsets.size(); ++i)
            near += points[tree.members()[cut.offsets[i]]].x() < 5e4F ? 1 : 0;
        EXPECT_GT(near, 60U);
        EXPECT_LT(near, 140U);
    }
}

TEST(ClusterTree, StopsWhenAsked) {
    const auto points = test::sphere(300'000).positions;
    std::stop_source source;
    source.request_stop();
    ClusterTree tree(points);
    EXPECT_THROW(tree.cut(100, {.stop = source.get_token()}), Cancelled);
}

TEST(PartitionMany, PartsPointsAsThePlaneDoes) {
    const auto points = test::cube(150'000).positions;
    const SplitPlane plane = {{0.4F, 0.5F, 0.6F}, {0.6F, -0.64F, 0.48F}, 0.05F};
    const auto is_left = [&](Index i) {
        const Vec3f d = points[i] - Vec3f(0.4F, 0.5F, 0.6F);
        return d.x() * 0.6F + d.y() * -0.64F + d.z() * 0.48F < 0.05F;
    };
    std::vector<Index> numbers = numbers_to(points.size()), room(points.size());
    const Sides sides = partition_many(points, numbers, plane, room, {});
    ASSERT_EQ(sides.left.count + sides.right.count, points.size());
    Vec3d left = Vec3d::Zero(), right = Vec3d::Zero();
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        EXPECT_EQ(is_left(numbers[i]), i < sides.left.count);
        (i < sides.left.count ? left : right) += points[numbers[i]].cast<double>();
    }
    EXPECT_LT((left / static_cast<double>(sides.left.count) - sides.left.centroid).norm(), 1e-6);
    EXPECT_LT((right / static_cast<double>(sides.right.count) - sides.right.centroid).norm(), 1e-6);
    std::ranges::sort(numbers);
    EXPECT_EQ(numbers, numbers_to(points.size()));
}

}  // namespace
}  // namespace stipple
