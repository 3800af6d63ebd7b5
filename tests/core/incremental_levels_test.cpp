#include "incremental_levels.hpp"

#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "stipple/surface_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace stipple {
namespace {

using Options = IncrementalClusteringOptions;

std::vector<PointCloud> levels_of(const PointCloud& cloud, const std::vector<std::uint64_t>& sizes,
                                  const Options& options = {}, const RunContext& context = {}) {
    std::vector<PointCloud> levels;
    incremental_levels(
        cloud, sizes, options, [&](PointCloud&& level) { levels.push_back(std::move(level)); },
        context);
    return levels;
}

std::vector<std::byte> alone(const PointCloud& cloud, std::uint64_t size, Options options = {}) {
    options.target_size = size;
    return encode_ply(incremental_clustering(cloud, options));
}

TEST(IncrementalLevels, HaveTheSizesThatAreAskedFor) {
    const PointCloud cloud = test::with_attributes(test::sphere(3000, 0.01));
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

TEST(IncrementalLevels, OfTheCloudAreWhatItsClusteringGives) {
    const PointCloud cloud = test::with_attributes(test::sphere(3000, 0.01));
    const std::vector<std::uint64_t> sizes = {3000, 1700, 750, 251};  // 250 is made of the 750
    const std::vector<PointCloud> levels = levels_of(cloud, sizes);
    for (std::size_t i = 0; i < sizes.size(); ++i)
        EXPECT_EQ(encode_ply(levels[i]), alone(cloud, sizes[i])) << sizes[i];
    EXPECT_NE(encode_ply(levels_of(cloud, {750, 250})[1]), alone(cloud, 250));
}

TEST(IncrementalLevels, WithABoundOnTheVariationAreAllOfTheCloud) {
    const PointCloud cloud = test::sphere(3000, 0.01);
    const Options options = {.max_variation = 0.02};
    EXPECT_EQ(encode_ply(levels_of(cloud, {750, 150}, options)[1]), alone(cloud, 150, options));
}

TEST(IncrementalLevels, OfLevelsComeAsNearAsThoseOfTheCloud) {
    const PointCloud cloud = test::sphere(40'000, 0.002);
    const std::vector<std::uint64_t> sizes = {10'000, 2'500, 625};
    const std::vector<PointCloud> levels = levels_of(cloud, sizes);
    for (std::size_t i = 1; i < sizes.size(); ++i) {
        const PointCloud of_cloud = incremental_clustering(cloud, {.target_size = sizes[i]});
        for (const ErrorSurface surface : {ErrorSurface::Linear, ErrorSurface::Quadratic}) {
            const auto mean = [&](const PointCloud& level) {
                return measure_error(cloud, level, {.surface = surface}).forward.mean;
            };
            EXPECT_LT(mean(levels[i]), 1.1 * mean(of_cloud)) << sizes[i];
        }
    }
}

TEST(IncrementalLevels, StandForAllPointsOfTheCloud) {
    PointCloud cloud = test::sphere(20'000, 0.002);
    std::vector<std::int32_t> numbers(cloud.size());
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = static_cast<std::int32_t>(i);
    cloud.attributes.push_back({"low", numbers, 1, Reduction::Min});
    cloud.attributes.push_back({"high", numbers, 1, Reduction::Max});
    const Options options = {.representative = Representative::Centroid,
                             .reductions = {{"low", Reduction::Min}, {"high", Reduction::Max}}};
    for (const PointCloud& level : levels_of(cloud, {5000, 1250, 312, 1}, options)) {
        const auto& low = std::get<std::vector<std::int32_t>>(level.attributes[0].values);
        const auto& high = std::get<std::vector<std::int32_t>>(level.attributes[1].values);
        EXPECT_EQ(std::ranges::min(low), 0);
        EXPECT_EQ(std::ranges::max(high), 19'999);
        if (level.size() > 1) continue;
        Vec3d sum = Vec3d::Zero();
        for (const Vec3f& p : cloud.positions) sum += p.cast<double>();
        EXPECT_LT((level.positions[0].cast<double>() - sum / 20'000).norm(), 1e-6);
    }
}

TEST(IncrementalLevels, AreTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::with_attributes(test::sphere(40'000, 0.01));
    RunContext one, eight;
    one.threads = 1;
    eight.threads = 8;
    const std::vector<std::uint64_t> sizes = {10'000, 2'500, 600};
    const auto by_one = levels_of(cloud, sizes, {}, one),
               by_eight = levels_of(cloud, sizes, {}, eight);
    ASSERT_EQ(by_one.size(), by_eight.size());
    for (std::size_t i = 0; i < by_one.size(); ++i)
        EXPECT_EQ(encode_ply(by_one[i]), encode_ply(by_eight[i])) << sizes[i];
}

}  // namespace
}  // namespace stipple
