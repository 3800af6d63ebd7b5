#include "stipple/lod_pyramid.hpp"

#include "stipple/codec.hpp"
#include "stipple/lod_tiles.hpp"
#include "stipple/neighbors.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numeric>
#include <set>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

namespace stipple {
namespace {

using Sizes = std::vector<std::uint64_t>;

std::vector<LodLevel> build(const PointCloud& cloud, const LodPyramidOptions& options,
                            const RunContext& context = {}) {
    std::vector<LodLevel> levels;
    build_lod_pyramid(
        cloud, options, [&](LodLevel&& level) { levels.push_back(std::move(level)); }, context);
    return levels;
}

TEST(LodSizes, ByRatioEndAtTheWholeCloudAndBeginBelowTheBase) {
    EXPECT_EQ(lod_sizes(134'345, {}), (Sizes{8'397, 33'586, 134'345}));
    EXPECT_EQ(lod_sizes(10'000, {}), (Sizes{10'000}));
    EXPECT_EQ(lod_sizes(1, {}), (Sizes{1}));
}

TEST(LodSizes, ByListAreTheListCutAtTheCount) {
    LodPyramidOptions options;
    options.sizes = {10, 100, 1000, 2000};
    EXPECT_EQ(lod_sizes(500, options), (Sizes{10, 100, 500}));
}

TEST(LodSizes, ARatioNearOneComesToAnEnd) {
    LodPyramidOptions options;
    options.ratio = 1.0001;
    options.base_points = 1;
    EXPECT_EQ(lod_sizes(50, options).size(), 50U);
}

TEST(LodSizes, RefusesMoreThan64Levels) {
    LodPyramidOptions options;
    options.ratio = 1.0001;
    options.base_points = 1;
    EXPECT_EQ(lod_sizes(64, options).size(), 64U);
    test::expect_refused("ratio 1.0001: makes more than 64 levels from 65 points",
                         [&] { lod_sizes(65, options); });
}

TEST(LodSizes, RefusesListsThatDoNotAscend) {
    const auto refuses = [](const Sizes& sizes, std::string_view part) {
        LodPyramidOptions options;
        options.sizes = sizes;
        test::expect_refused(part, [&] { lod_sizes(100, options); });
    };
    refuses({0, 5}, "levels: 0 points: expected at least 1");
    refuses({5, 5}, "levels: 5 after 5: expected each to be larger");
    refuses({9, 5}, "levels: 5 after 9: expected each to be larger");
}

TEST(LodPyramid, GivesEveryLevelCoarsestFirstWithExactCounts) {
    LodPyramidOptions options;
    options.base_points = 50;
    const PointCloud cloud = test::with_attributes(test::sphere(5000));
    const auto levels = build(cloud, options);
    const Sizes sizes = lod_sizes(cloud.size(), options);
    ASSERT_EQ(levels.size(), sizes.size());
    for (unsigned i = 0; i < levels.size(); ++i) {
        EXPECT_EQ(levels[i].level, i);
        EXPECT_EQ(levels[i].cloud.size(), sizes[i]);
        EXPECT_EQ(levels[i].cloud.colors.size(), sizes[i]);
        EXPECT_EQ(levels[i].cloud.attributes.size(), cloud.attributes.size());
        if (i > 0) {
            EXPECT_LT(levels[i].spacing, levels[i - 1].spacing);
        }
    }
    EXPECT_EQ(levels.back().cloud.positions, cloud.positions);
}

TEST(LodPyramid, ALevelIsWhatSimplifyGivesForItsCount) {
    const PointCloud cloud = test::with_attributes(test::sphere(4000, 0.02));
    for (const Method method : kMethods) {
        if (method == Method::Multiphase) continue;  // `MultiphaseRuns` has its own test
        LodPyramidOptions options;
        options.simplification.method = method;
        options.simplification.seed = 5;
        options.simplification.iterative.color_weight = 0.1;
        options.simplification.particles.adaptivity = 0.5;
        options.simplification.incremental.max_variation = 0.05;
        options.sizes = {17, 300, 1111};
        for (const LodLevel& level : build(cloud, options)) {
            const bool of_level = method == Method::Iterative && level.cloud.size() < 1111;
            if (of_level) continue;  // `IterativeLevels` have their own tests
            SimplifyOptions alone = options.simplification;
            alone.points = level.cloud.size();
            if (method != Method::Random) alone.reductions["color"] = Reduction::Mean;
            EXPECT_EQ(encode_ply(level.cloud), encode_ply(simplify(cloud, alone)))
                << to_string(method);
        }
    }
}

TEST(LodPyramid, LevelsOfPointsHaveMeansOfColours) {
    // Black and white: single points would be either, all of them together are one gray.
    PointCloud cloud = test::sphere(4'000);
    for (std::size_t i = 0; i < cloud.size(); ++i)
        cloud.colors.push_back(i % 2 == 0 ? Rgba8{0, 0, 0, 255} : Rgba8{255, 255, 255, 255});
    for (const Method method : {Method::Hierarchical, Method::Incremental, Method::Voxel}) {
        LodPyramidOptions options;
        options.simplification.method = method;
        options.sizes = {40};
        const PointCloud level = build(cloud, options).front().cloud;
        unsigned gray = 0;  // but where a point stands for few, as in the corner of a voxel
        for (std::size_t i = 0; i < level.size(); ++i) {
            gray += std::abs(level.colors[i].r - 188) <= 30 ? 1 : 0;
            EXPECT_NE(std::ranges::find(cloud.positions, level.positions[i]),
                      cloud.positions.end());
        }
        EXPECT_GE(gray, 36U) << to_string(method);
        options.simplification.reductions["color"] = Reduction::Nearest;
        const PointCloud copied = build(cloud, options).front().cloud;
        for (const Rgba8& color : copied.colors)
            EXPECT_TRUE(color.r == 0 || color.r == 255) << to_string(method);
    }
}

TEST(LodPyramid, OfTheseMethodsGivesEachLevelBeforeTheNextIsBegun) {
    // The tree is three tenths of multiphase, the surface one of particles.
    for (const auto& [method, prepared] :
         {std::pair(Method::Multiphase, 0.3), std::pair(Method::Particles, 0.1)}) {
        std::vector<double> progress;
        LodPyramidOptions options;
        options.simplification.method = method;
        options.sizes = {20, 200, 2000};
        double now = 0;
        build_lod_pyramid(test::sphere(4000), options, [&](LodLevel&&) { progress.push_back(now); },
                          {.progress = [&](double fraction) { now = fraction; }});
        ASSERT_EQ(progress.size(), 3U);
        EXPECT_LT(progress[0], prepared + 0.1) << to_string(method);
        EXPECT_LT(progress[1], prepared + 0.2) << to_string(method);
    }
}

TEST(LodPyramid, RefusesTargetsAndBoundsOfItsMethod) {
    LodPyramidOptions options;
    options.simplification.points = 5;
    test::expect_refused("target: a pyramid has none", [&] { validate(options); });
    options.simplification.points = {};
    options.simplification.method = Method::Hierarchical;
    options.simplification.hierarchical.max_variation = 0.1;
    test::expect_refused("max_variation: levels have counts instead", [&] { validate(options); });
    options.simplification.method = Method::Voxel;
    EXPECT_NO_THROW(validate(options));
    options.simplification.voxel.voxel_size = 1;
    test::expect_refused("voxel_size: levels have counts instead", [&] { validate(options); });
}

TEST(LodPyramid, OfEveryMethodHasExactCountsAndProgressThatNeverGoesBack) {
    const PointCloud cloud = test::with_attributes(test::sphere(4000));
    for (const Method method : kMethods) {
        LodPyramidOptions options;
        options.simplification.method = method;
        options.sizes = {1, 60, 700, 4000};
        double last = 0;
        const auto levels = build(cloud, options, {.progress = [&](double fraction) {
                                      EXPECT_GE(fraction, last);
                                      last = fraction;
                                  }});
        EXPECT_EQ(last, 1.0);
        ASSERT_EQ(levels.size(), 4U);
        for (unsigned i = 0; i < 4; ++i) {
            EXPECT_EQ(levels[i].level, i);
            EXPECT_EQ(levels[i].cloud.size(), options.sizes[i]);
            EXPECT_EQ(levels[i].cloud.attributes.size(), cloud.attributes.size());
        }
        EXPECT_EQ(levels.back().cloud.positions, cloud.positions);
    }
}

TEST(LodPyramid, WithNestedLevelsBeginsEachWithThePointsOfTheOneAbove) {
    const PointCloud cloud = test::with_attributes(test::sphere(3000, 0.02));
    LodPyramidOptions options;
    options.nested = true;
    options.simplification.method = Method::Iterative;
    options.sizes = {40, 500, 3000};
    const auto levels = build(cloud, options);
    ASSERT_EQ(levels.size(), 3U);
    for (std::size_t i = 1; i < levels.size(); ++i) {
        const PointCloud &above = levels[i - 1].cloud, &level = levels[i].cloud;
        ASSERT_EQ(level.size(), options.sizes[i]);
        for (std::size_t p = 0; p < above.size(); ++p) {
            EXPECT_EQ(above.positions[p], level.positions[p]);
            EXPECT_EQ(above.colors[p], level.colors[p]);
        }
    }
    auto sorted = levels.back().cloud.positions, all = cloud.positions;
    for (auto* const positions : {&sorted, &all})
        std::ranges::sort(*positions, {}, [](const Vec3f& p) {
            return std::array{p.x(), p.y(), p.z()};
        });
    EXPECT_EQ(sorted, all);
}

TEST(LodPyramid, WithNestedLevelsIsOfIterativeAloneAndReducesNothing) {
    LodPyramidOptions options;
    options.nested = true;
    test::expect_refused("method hierarchical: expected iterative for nested levels",
                         [&] { validate(options); });
    options.simplification.method = Method::Iterative;
    EXPECT_NO_THROW(validate(options));
    options.simplification.iterative.color_weight = 0.1;
    test::expect_refused("nested levels: their order follows the shape alone",
                         [&] { validate(options); });
    options.simplification.iterative = {};
    options.simplification.reductions = {{"intensity", Reduction::Mean}};
    test::expect_refused("reductions: intensity: points of nested levels keep their attributes",
                         [&] { validate(options); });
}

class LodPyramidWithABase : public testing::TestWithParam<Method> {};

TEST_P(LodPyramidWithABase, BeginsWithTheLargestThatFits) {
    const PointCloud cloud = test::sphere(4000, 0.02);
    LodPyramidOptions options;
    options.simplification.method = GetParam();
    options.base_points = 900;  // below the next level: what is tried changes no other
    std::size_t asked = 0;
    std::vector<Vec3f> fitting;
    options.base_fits = [&](const PointCloud& level) {
        ++asked;
        if (level.size() <= 200) fitting = level.positions;
        return level.size() <= 200;
    };
    std::vector<Index> backwards(cloud.size());
    std::iota(backwards.rbegin(), backwards.rend(), 0U);
    options.order = backwards;
    const auto levels = build(cloud, options);
    EXPECT_EQ(levels[0].cloud.positions, fitting);
    EXPECT_LE(asked, 8U);
    ASSERT_EQ(levels.size(), 3U);
    EXPECT_LE(levels[0].cloud.size(), 200U);
    EXPECT_GT(levels[0].cloud.size(), 179U);
    EXPECT_EQ(levels[1].cloud.size(), 1000U);
    EXPECT_EQ(levels[2].cloud.positions, cloud.positions);

    options.base_fits = {};
    options.order = {};
    options.sizes = {levels[0].cloud.size(), 1000, 4000};
    EXPECT_EQ(levels[0].cloud.positions, build(cloud, options)[0].cloud.positions);
}

INSTANTIATE_TEST_SUITE_P(, LodPyramidWithABase, testing::ValuesIn(kMethods),
                         [](const auto& method) { return std::string(to_string(method.param)); });

TEST(LodPyramid, WithABaseThatAllFitsIsTheCloudAlone) {
    LodPyramidOptions options;
    const PointCloud cloud = test::sphere(4000);
    options.base_fits = [&](const PointCloud& level) {
        EXPECT_TRUE(level.size() < cloud.size() || level.positions == cloud.positions);
        return true;
    };
    ASSERT_EQ(build(cloud, options).size(), 1U);
    options.base_fits = [](const PointCloud&) { return false; };
    test::expect_refused("base_fits: expected to accept a level of one point",
                         [&] { build(cloud, options); });
    options.base_fits = [&](const PointCloud& level) { return level.size() < cloud.size(); };
    EXPECT_EQ(build(cloud, options).back().cloud.positions, cloud.positions);
}

/// A cube with rounded edges: flat but for a few percent of its surface.
PointCloud rounded_cube(std::size_t n) {
    constexpr float kRadius = 0.1F, kFlat = 1 - kRadius;
    PointCloud cloud = test::sphere(n);
    for (Vec3f& p : cloud.positions) {
        p /= p.cwiseAbs().maxCoeff();
        const Vec3f inside = p.cwiseMax(-kFlat).cwiseMin(kFlat);
        p = inside + kRadius * (p - inside).normalized();
    }
    return cloud;
}

/// A plane with hills on a sixteenth of it.
PointCloud hills_on_a_plane(std::size_t n) {
    PointCloud cloud = test::plane(n);
    for (Vec3f& p : cloud.positions)
        if (p.x() < 0.25F && p.y() < 0.25F)
            p.z() = 0.01F * std::sin(150 * p.x()) * std::sin(150 * p.y());
    return cloud;
}

class LodPyramidOfFlatParts
    : public testing::TestWithParam<std::tuple<Method, PointCloud (*)(std::size_t)>> {};

TEST_P(LodPyramidOfFlatParts, HasNoHoleWiderThanItsBound) {
    const auto& [method, shape] = GetParam();
    const PointCloud cloud = shape(20'000);
    for (const LodLevel& level :
         build(cloud, {.base_points = 500, .simplification = {.method = method}})) {
        const NeighborSearch search(level.cloud.positions);
        double cover = 0;
        for (const Vec3f& p : cloud.positions) {
            Neighbor nearest;
            search.nearest(p, {&nearest, 1});
            cover = std::max(cover, std::sqrt(static_cast<double>(nearest.distance_sq)));
        }
        EXPECT_LT(cover, 3 * level.spacing) << level.cloud.size();
    }
}

INSTANTIATE_TEST_SUITE_P(, LodPyramidOfFlatParts,
                         testing::Combine(testing::Values(Method::Hierarchical, Method::Multiphase,
                                                          Method::Iterative, Method::Incremental,
                                                          Method::Particles, Method::Voxel),
                                          testing::Values(rounded_cube, hills_on_a_plane)));

TEST(LodPyramid, IsTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::sphere(60'000, 0.02);
    for (const Method method : {Method::Multiphase, Method::Hierarchical}) {
        const LodPyramidOptions options{.simplification = {.method = method}};
        const auto one = build(cloud, options, {.threads = 1});
        const auto eight = build(cloud, options, {.threads = 8});
        ASSERT_EQ(one.size(), eight.size());
        for (std::size_t i = 0; i < one.size(); ++i) {
            EXPECT_EQ(one[i].cloud.positions, eight[i].cloud.positions);
            EXPECT_EQ(one[i].spacing, eight[i].spacing);
        }
    }
}

TEST(LodPyramid, InTheOrderOfACurveHasTheSameLevels) {
    PointCloud cloud = test::sphere(20'000);
    cloud.colors.resize(cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        // Of a sphere rounding would decide across which axis it is cut first.
        cloud.positions[i] = cloud.positions[i].cwiseProduct(Vec3f(5, 2, 1));
        cloud.colors[i].r = static_cast<std::uint8_t>(i % 251);
    }
    const LodTiler tiler(cloud, {});
    LodPyramidOptions options{.sizes = {1'000, 5'000, 20'000},
                              .simplification = {.method = Method::Hierarchical}};
    const std::vector<LodLevel> as_they_stand = build(cloud, options);
    options.order = tiler.order();
    const std::vector<LodLevel> along = build(cloud, options);
    ASSERT_EQ(along.size(), 3U);
    for (std::size_t level = 0; level < 3; ++level) {
        // Sums in another order round otherwise, and a few points fall on the other side.
        using Point = std::tuple<float, float, float, int>;
        std::array<std::set<Point>, 2> points;
        for (const bool second : {false, true}) {
            const PointCloud& made = (second ? along : as_they_stand)[level].cloud;
            for (std::size_t i = 0; i < made.size(); ++i) {
                const Vec3f& p = made.positions[i];
                points[second ? 1 : 0].emplace(p.x(), p.y(), p.z(), made.colors[i].r);
            }
        }
        std::vector<Point> common;
        std::ranges::set_intersection(points[0], points[1], std::back_inserter(common));
        EXPECT_EQ(points[0].size(), points[1].size());
        EXPECT_GE(common.size(), 0.95 * static_cast<double>(points[0].size())) << level;
    }
}

TEST(LodPyramid, LevelsAlongACurveSayTheirOrder) {
    const PointCloud cloud = test::sphere(20'000);
    const LodTiler tiler(cloud, {});
    const auto levels = build(cloud, {.sizes = {1'000, 5'000, 20'000},
                                      .simplification = {.method = Method::Hierarchical},
                                      .order = tiler.order()});
    for (const LodLevel& level : std::span(levels).first(2)) {
        ASSERT_EQ(level.order.size(), level.cloud.size());
        EXPECT_EQ(std::set<Index>(level.order.begin(), level.order.end()).size(),
                  level.cloud.size());
        double way = 0;
        for (std::size_t i = 1; i < level.order.size(); ++i) {
            way += static_cast<double>(
                (level.cloud.positions[level.order[i]] - level.cloud.positions[level.order[i - 1]])
                    .norm());
        }
        EXPECT_LT(way, 2.5 * level.spacing * static_cast<double>(level.order.size()));
    }
    EXPECT_TRUE(levels.back().order.empty());
    for (const LodLevel& level : build(cloud, {.sizes = {1'000, 5'000}}))
        EXPECT_TRUE(level.order.empty());
}

TEST(LodPyramid, RefusesAnOrderOfAnotherNumberOfPoints) {
    const std::vector<Index> order(99);
    test::expect_refused("order of 99 points: expected all 100",
                         [&] { build(test::sphere(100), {.order = order}); });
}

TEST(LodPyramid, OfACloudThatIsGivenAwayHasTheSameLevels) {
    const PointCloud cloud = test::with_attributes(test::sphere(2000));
    for (const Method method : kMethods) {
        for (const bool nested : {false, true}) {
            if (nested && method != Method::Iterative) continue;
            const LodPyramidOptions options{
                .base_points = 200, .simplification = {.method = method}, .nested = nested};
            const std::vector<LodLevel> expected = build(cloud, options);
            PointCloud given = cloud;
            const PointCloud& spent = given;
            const Vec3f* const positions = given.positions.data();
            std::vector<LodLevel> levels;
            build_lod_pyramid(std::move(given), options, [&](LodLevel&& level) {
                const bool whole = level.cloud.size() == cloud.size();
                EXPECT_EQ(spent.empty(), whole && !nested);
                EXPECT_EQ(level.cloud.positions.data() == positions, whole && !nested);
                levels.push_back(std::move(level));
            });
            ASSERT_EQ(levels.size(), expected.size());
            for (std::size_t i = 0; i < levels.size(); ++i)
                EXPECT_EQ(encode_ply(levels[i].cloud), encode_ply(expected[i].cloud)) << i;
        }
    }
}

TEST(LodPyramid, OfOnePointIsOneLevel) {
    const auto levels = build(test::cube(1), {});
    ASSERT_EQ(levels.size(), 1U);
    EXPECT_EQ(levels[0].spacing, 0.0);
}

TEST(LodPyramid, RefusesAnEmptyCloud) {
    test::expect_refused("the cloud has no points", [&] { build({}, {}); });
}

}  // namespace
}  // namespace stipple
