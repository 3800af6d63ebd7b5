#include "iterative_levels.hpp"

#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "stipple/surface_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

namespace stipple {
namespace {

using Options = IterativeSimplificationOptions;

std::vector<PointCloud> levels_of(const PointCloud& cloud, const std::vector<std::uint64_t>& sizes,
                                  const Options& options = {}, const RunContext& context = {}) {
    std::vector<PointCloud> levels;
    iterative_levels(
        cloud, sizes, options, [&](PointCloud&& level) { levels.push_back(std::move(level)); },
        context);
    return levels;
}

TEST(IterativeLevels, HaveTheSizesThatAreAskedFor) {
    const PointCloud cloud = test::with_attributes(test::sphere(3000, 0.01));
    // Of one base; each of the one before; all of these, and alike.
    for (const std::vector<std::uint64_t>& sizes : std::vector<std::vector<std::uint64_t>>{
             {2999, 2000, 1001},
             {750, 187, 46, 11, 2},
             {3000, 2999, 1500, 1000, 1000, 999, 334, 333, 333, 332, 110, 37, 12, 4, 3, 1, 1}}) {
        const std::vector<PointCloud> levels = levels_of(cloud, sizes);
        ASSERT_EQ(levels.size(), sizes.size());
        for (std::size_t i = 0; i < sizes.size(); ++i) {
            validate(levels[i]);
            EXPECT_EQ(levels[i].size(), sizes[i]);
            EXPECT_EQ(levels[i].attributes.size(), cloud.attributes.size());
        }
    }
}

TEST(IterativeLevels, ThatTheCloudIsContractedToAreItsSnapshots) {
    const PointCloud cloud = test::with_attributes(test::sphere(3000, 0.01));
    const std::vector<std::uint64_t> sizes = {3000, 1700, 750, 251};  // 250 is made of the 750
    const std::vector<PointCloud> levels = levels_of(cloud, sizes);
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        EXPECT_EQ(encode_ply(levels[i]),
                  encode_ply(iterative_simplification(cloud, {.target_size = sizes[i]})))
            << sizes[i];
    }
    EXPECT_NE(levels_of(cloud, {750, 250})[1].positions,
              iterative_simplification(cloud, {.target_size = 250}).positions);
}

TEST(IterativeLevels, OfLevelsComeAsNearAsThoseOfTheCloud) {
    const PointCloud cloud = test::sphere(40'000, 0.002);
    const std::vector<std::uint64_t> sizes = {10'000, 2'500, 625};
    const std::vector<PointCloud> levels = levels_of(cloud, sizes);
    for (std::size_t i = 1; i < sizes.size(); ++i) {
        const PointCloud alone = iterative_simplification(cloud, {.target_size = sizes[i]});
        for (const ErrorSurface surface : {ErrorSurface::Linear, ErrorSurface::Quadratic}) {
            const auto mean = [&](const PointCloud& level) {
                return measure_error(cloud, level, {.surface = surface}).forward.mean;
            };
            EXPECT_LT(mean(levels[i]), 1.1 * mean(alone)) << sizes[i];
        }
    }
}

TEST(IterativeLevels, StandForAllPointsOfTheCloud) {
    PointCloud cloud = test::sphere(20'000, 0.002);
    std::vector<std::int32_t> numbers(cloud.size());
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = static_cast<std::int32_t>(i);
    cloud.attributes.push_back({"low", numbers, 1, Reduction::Min});
    cloud.attributes.push_back({"high", numbers, 1, Reduction::Max});
    cloud.attributes.push_back({"mean", std::vector<double>(numbers.begin(), numbers.end())});
    cloud.attributes.back().reduction = Reduction::Mean;
    for (const PointCloud& level : levels_of(cloud, {5000, 1250, 312, 1})) {
        const auto& low = std::get<std::vector<std::int32_t>>(level.attributes[0].values);
        const auto& high = std::get<std::vector<std::int32_t>>(level.attributes[1].values);
        EXPECT_EQ(std::ranges::min(low), 0);
        EXPECT_EQ(std::ranges::max(high), 19'999);
        if (level.size() == 1) {
            EXPECT_EQ(low[0], 0);
            EXPECT_EQ(std::get<std::vector<double>>(level.attributes[2].values)[0], 9'999.5);
        }
    }
}

TEST(IterativeLevels, KeepToTheBoundOnDisplacements) {
    const PointCloud cloud = test::sphere(20'000);
    for (const PointCloud& level :
         levels_of(cloud, {5000, 1250, 200}, {.max_displacement = 0.002})) {
        for (const Vec3f& p : level.positions) EXPECT_NEAR(p.norm(), 1, 0.002 + 2e-4);
    }
}

TEST(IterativeLevels, OfEndPointsAreSubsetsOfEachOther) {
    const PointCloud cloud = test::sphere(3000, 0.01);
    const std::vector<std::uint64_t> sizes = {1000, 200, 30};
    const Options options = {.placement = Placement::EndPoint};
    const std::vector<PointCloud> levels = levels_of(cloud, sizes, options);
    std::size_t i = 0;
    iterative_snapshots(cloud, sizes, options, [&](PointCloud&& snapshot) {
        EXPECT_EQ(levels[i++].positions, snapshot.positions);
    });
}

TEST(IterativeLevels, AreTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::with_attributes(test::sphere(20'000, 0.01));
    const Options options{.max_displacement = 0.001, .color_weight = 0.01};
    RunContext one, eight;
    one.threads = 1;
    eight.threads = 8;
    const std::vector<std::uint64_t> sizes = {5000, 1250, 300};
    const auto by_one = levels_of(cloud, sizes, options, one),
               by_eight = levels_of(cloud, sizes, options, eight);
    ASSERT_EQ(by_one.size(), by_eight.size());
    for (std::size_t i = 0; i < by_one.size(); ++i)
        EXPECT_EQ(encode_ply(by_one[i]), encode_ply(by_eight[i])) << sizes[i];
}

TEST(IterativeLevels, RefuseSizesThatDoNotDescend) {
    const PointCloud cloud = test::sphere(20);
    for (const std::vector<std::uint64_t>& sizes :
         std::vector<std::vector<std::uint64_t>>{{21}, {5, 6}, {5, 0}})
        EXPECT_THROW(levels_of(cloud, sizes), Error);
}

}  // namespace
}  // namespace stipple
