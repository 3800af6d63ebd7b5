#include "clustering/incremental_levels.hpp"
#include "contraction/iterative_levels.hpp"
#include "stipple/codec.hpp"
#include "stipple/surface_error.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cstdint>
#include <functional>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace stipple {
namespace {

using Sizes = std::vector<std::uint64_t>;

/// Levels of a cloud, and what is made of the cloud alone.
struct Iterative {
    using Options = IterativeSimplificationOptions;
    static constexpr auto levels = iterative_levels;
    static constexpr auto alone = iterative_simplification;
    static Options reduced() { return {}; }
    static Sizes of_cloud() { return {3000, 1700, 750, 251}; }  // 250 is made of the 750
};
struct Incremental {
    using Options = IncrementalClusteringOptions;
    static void levels(const PointCloud& cloud, const Sizes& sizes, const Options& options,
                       const std::function<void(PointCloud&&)>& on_cloud,
                       const RunContext& context) {
        incremental_levels(
            cloud, {}, sizes, options, [&](LodLevel&& level) { on_cloud(std::move(level.cloud)); },
            context);
    }
    static constexpr auto alone = incremental_clustering;
    /// Whose attributes are reduced by their policies.
    static Options reduced() { return {.representative = Representative::Centroid}; }
    static Sizes of_cloud() { return {3000, 1700, 750, 376}; }  // fewer are grown where alone
};

template <typename Method>
std::vector<PointCloud> levels_of(const PointCloud& cloud, const Sizes& sizes,
                                  const typename Method::Options& options = {},
                                  unsigned threads = 0) {
    std::vector<PointCloud> levels;
    Method::levels(cloud, sizes, options,
                   [&](PointCloud&& level) { levels.push_back(std::move(level)); },
                   {.threads = threads});
    return levels;
}

template <typename Method>
PointCloud alone(const PointCloud& cloud, std::uint64_t size,
                 typename Method::Options options = {}) {
    options.target_size = size;
    return Method::alone(cloud, options, {});
}

template <typename Method>
class LevelsOfLevels : public testing::Test {};

struct Names {
    template <typename Method>
    static std::string GetName(int) {
        return std::is_same_v<Method, Iterative> ? "iterative" : "incremental";
    }
};
using Methods = testing::Types<Iterative, Incremental>;
TYPED_TEST_SUITE(LevelsOfLevels, Methods, Names);

TYPED_TEST(LevelsOfLevels, HaveTheSizesThatAreAskedFor) {
    const PointCloud cloud = test::with_attributes(test::sphere(3000, 0.01));
    // Of one base; each of the one before; all of these, and alike.
    for (const Sizes& sizes :
         {Sizes{2999, 2000, 1001}, Sizes{750, 187, 46, 11, 2},
          Sizes{3000, 2999, 1500, 1000, 1000, 999, 334, 333, 333, 332, 110, 37, 12, 4, 3, 1, 1}}) {
        const std::vector<PointCloud> levels = levels_of<TypeParam>(cloud, sizes);
        ASSERT_EQ(levels.size(), sizes.size());
        for (std::size_t i = 0; i < sizes.size(); ++i) {
            validate(levels[i]);
            EXPECT_EQ(levels[i].size(), sizes[i]);
            EXPECT_EQ(levels[i].attributes.size(), cloud.attributes.size());
        }
    }
}

TYPED_TEST(LevelsOfLevels, OfTheCloudAreWhatTheMethodGives) {
    const PointCloud cloud = test::with_attributes(test::sphere(3000, 0.01));
    const Sizes sizes = TypeParam::of_cloud();
    const std::vector<PointCloud> levels = levels_of<TypeParam>(cloud, sizes);
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        EXPECT_EQ(encode_ply(levels[i]), encode_ply(alone<TypeParam>(cloud, sizes[i]))) << sizes[i];
    }
    EXPECT_NE(levels_of<TypeParam>(cloud, {750, 250})[1].positions,
              alone<TypeParam>(cloud, 250).positions);
}

TYPED_TEST(LevelsOfLevels, ComeAsNearAsThoseOfTheCloud) {
    const PointCloud cloud = test::sphere(40'000, 0.002);
    const Sizes sizes = {10'000, 2'500, 625};
    const std::vector<PointCloud> levels = levels_of<TypeParam>(cloud, sizes);
    for (std::size_t i = 1; i < sizes.size(); ++i) {
        const PointCloud of_cloud = alone<TypeParam>(cloud, sizes[i]);
        for (const ErrorSurface surface : {ErrorSurface::Linear, ErrorSurface::Quadratic}) {
            const auto mean = [&](const PointCloud& level) {
                return measure_error(cloud, level, {.surface = surface}).forward.mean;
            };
            EXPECT_LT(mean(levels[i]), 1.1 * mean(of_cloud)) << sizes[i];
        }
    }
}

TYPED_TEST(LevelsOfLevels, StandForAllPointsOfTheCloud) {
    PointCloud cloud = test::sphere(20'000, 0.002);
    std::vector<std::int32_t> numbers(cloud.size());
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = static_cast<std::int32_t>(i);
    cloud.attributes.push_back({"low", numbers, 1, Reduction::Min});
    cloud.attributes.push_back({"high", numbers, 1, Reduction::Max});
    cloud.attributes.push_back(
        {"mean", std::vector<double>(numbers.begin(), numbers.end()), 1, Reduction::Mean});
    const Sizes sizes = {5000, 1250, 312, 1};
    const auto levels = levels_of<TypeParam>(cloud, sizes, TypeParam::reduced());
    for (const PointCloud& level : levels) {
        const auto& low = std::get<std::vector<std::int32_t>>(level.attributes[0].values);
        const auto& high = std::get<std::vector<std::int32_t>>(level.attributes[1].values);
        EXPECT_EQ(std::ranges::min(low), 0);
        EXPECT_EQ(std::ranges::max(high), 19'999);
    }
    const auto& mean = std::get<std::vector<double>>(levels.back().attributes[2].values);
    EXPECT_EQ(mean, std::vector{9'999.5});
}

TYPED_TEST(LevelsOfLevels, AreTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::with_attributes(test::sphere(40'000, 0.01));
    const Sizes sizes = {10'000, 2'500, 600};
    const auto by_one = levels_of<TypeParam>(cloud, sizes, {}, 1),
               by_eight = levels_of<TypeParam>(cloud, sizes, {}, 8);
    ASSERT_EQ(by_one.size(), by_eight.size());
    for (std::size_t i = 0; i < by_one.size(); ++i)
        EXPECT_EQ(encode_ply(by_one[i]), encode_ply(by_eight[i])) << sizes[i];
}

TYPED_TEST(LevelsOfLevels, TellTheirProgressWithinALevel) {
    std::vector<double> told;
    TypeParam::levels(
        test::sphere(20'000), Sizes{5000, 1250, 100}, {}, [](PointCloud&&) {},
        {.progress = [&](double fraction) { told.push_back(fraction); }});
    EXPECT_TRUE(std::ranges::is_sorted(told));
    EXPECT_LT(told.front(), 0.5);  // the finest, which takes most of the time, ends at 0.7
    EXPECT_GT(told.back(), 0.9);
    EXPECT_LE(told.back(), 1);
}

TEST(IterativeLevels, OfColorsAndABoundAreTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::with_attributes(test::sphere(20'000, 0.01));
    const Iterative::Options options{.max_displacement = 0.001, .color_weight = 0.01};
    const Sizes sizes = {5000, 1250, 300};
    const auto by_one = levels_of<Iterative>(cloud, sizes, options, 1),
               by_eight = levels_of<Iterative>(cloud, sizes, options, 8);
    for (std::size_t i = 0; i < sizes.size(); ++i)
        EXPECT_EQ(encode_ply(by_one.at(i)), encode_ply(by_eight.at(i))) << sizes[i];
}

TEST(IterativeLevels, KeepToTheBoundOnDisplacements) {
    const PointCloud cloud = test::sphere(20'000);
    for (const PointCloud& level :
         levels_of<Iterative>(cloud, {5000, 1250, 200}, {.max_displacement = 0.002})) {
        for (const Vec3f& p : level.positions) EXPECT_NEAR(p.norm(), 1, 0.002 + 2e-4);
    }
}

TEST(IterativeLevels, OfEndPointsAreSubsetsOfEachOther) {
    const PointCloud cloud = test::sphere(3000, 0.01);
    const Sizes sizes = {1000, 200, 30};
    const Iterative::Options options = {.placement = Placement::EndPoint};
    const std::vector<PointCloud> levels = levels_of<Iterative>(cloud, sizes, options);
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        EXPECT_EQ(levels.at(i).positions, alone<Iterative>(cloud, sizes[i], options).positions);
    }
}

TEST(IterativeLevels, RefuseSizesThatDoNotDescend) {
    const PointCloud cloud = test::sphere(20);
    for (const Sizes& sizes : {Sizes{21}, Sizes{5, 6}, Sizes{5, 0}}) {
        test::expect_refused("size " + std::to_string(sizes.back()) + ": expected 1..",
                             [&] { levels_of<Iterative>(cloud, sizes); });
    }
}

TEST(IncrementalLevels, WithABoundOnTheVariationAreAllOfTheCloud) {
    const PointCloud cloud = test::sphere(3000, 0.01);
    const Incremental::Options options = {.max_variation = 0.02};
    const Sizes sizes = {750, 150};
    EXPECT_EQ(encode_ply(levels_of<Incremental>(cloud, sizes, options).at(1)),
              encode_ply(alone<Incremental>(cloud, 150, options)));
}

}  // namespace
}  // namespace stipple
