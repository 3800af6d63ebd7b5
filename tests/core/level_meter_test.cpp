#include "pyramid/level_meter.hpp"

#include "cloud/hilbert_order.hpp"
#include "pyramid/level_rounding.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>

namespace stipple {
namespace {

std::vector<Vec3f> sphere_along_curve() {
    const std::vector<Vec3f> scan = test::sphere(50'000).positions;
    std::vector<Vec3f> points;
    for (const Index i : hilbert_order(scan, {})) points.push_back(scan[i]);
    return points;
}

TEST(MeasuredLevel, IsSearchedForOnePointOfEachPlaceWhereMostHaveOthers) {
    std::vector<Vec3f> crowd(900, Vec3f(1, 2, 3));
    crowd.resize(1'000, Vec3f(4, 5, 6));
    const MeasuredLevel crowded(std::vector<Vec3f>(crowd), {});
    EXPECT_EQ(crowded.points, crowd);
    ASSERT_EQ(crowded.samples().size(), 2U);
    EXPECT_EQ(crowded.tree->size(), 2U);

    std::vector<Vec3f> few = test::sphere(1'000).positions;
    few[1] = few[0];
    const MeasuredLevel even(std::move(few), {});
    EXPECT_EQ(even.samples().size(), 1'000U);
}

TEST(LevelRounding, TakesACrowdToTheGridAsItIs) {
    std::vector<Vec3f> crowd(300, Vec3f(0.1F, 0.2F, 0.3F));
    for (const Vec3f& p : test::sphere(100).positions) crowd.push_back(p);
    const LevelMeter meter(std::vector<Vec3f>(test::sphere(2'000).positions), LodErrors::Sure, {});
    LevelRounding rounding{.side = 2, .tolerance = 0.16, .position_bits = 14};
    LevelGrid taken{1, 1};
    const MeasuredLevel level =
        rounding.round(MeasuredLevel(std::vector<Vec3f>(crowd), {}), taken, meter, {});
    EXPECT_EQ(level.points, rounded(crowd, taken, {}));
}

TEST(LevelRounding, OfALevelWithoutErrorTellsNothingThatHarmsTheNext) {
    std::vector<Vec3f> points;  // of a tilted plane, off which rounding takes them
    for (const Vec3f& p : test::plane(20'000).positions)
        points.emplace_back(p.x(), p.y(), 0.3F * p.x());
    const std::vector<Index> order = hilbert_order(points, {});
    std::vector<Vec3f> few, wavy;
    for (std::size_t i = 0; i < points.size(); i += 10) {
        few.push_back(points[order[i]]);
        wavy.push_back(few.back() + Vec3f(0, 0, 0.01F * std::sin(40 * few.back().y())));
    }
    const LevelMeter meter(std::move(points), LodErrors::Sure, {});
    for (const double tolerance : {0.0, 0.16}) {
        LevelRounding rounding{.side = 1, .tolerance = tolerance, .position_bits = 14};
        for (const auto* const level : {&few, &wavy}) {
            LevelGrid taken{1, 1};
            (void)rounding.round(MeasuredLevel(std::vector<Vec3f>(*level), {}), taken, meter, {});
            EXPECT_GE(taken.step, rounding.finest_grid(meter).step);
            EXPECT_LT(taken.step, 0.1);
        }
    }
}

TEST(LevelMeter, MakesNoSurfaceAnewForLevelsOfSmoothScans) {
    std::vector<Vec3f> points = sphere_along_curve();
    LevelMeter meter(std::vector<Vec3f>(points), LodErrors::Sure, {});
    meter.forget_surface();
    const std::vector<Vec3f>* const own = &meter.source();  // a surface has its own
    std::vector<Vec3f> few;
    for (std::size_t i = 0; i < points.size(); i += 16) few.push_back(points[i]);
    for (std::vector<Vec3f>* const of_level : {&few, &points}) {
        MeasuredLevel level(std::move(*of_level), {});
        meter.measure_well(level, {});
        EXPECT_GT(level.places.size(), 4'096U);
        EXPECT_EQ(&meter.source(), own);
    }
}

TEST(LevelMeter, MeasuresNoPlaceTwice) {
    std::vector<Vec3f> points = sphere_along_curve();
    const LevelMeter meter(std::vector<Vec3f>(points), LodErrors::Sure, {});
    MeasuredLevel level(std::move(points), {});
    meter.measure_at_some(level, {});
    level.distances.assign(level.distances.size(), 7);
    EXPECT_FLOAT_EQ(static_cast<float>(meter.mean_at_a_glance(level)), 7);
    meter.glance(level, {});  // fewer of them
    EXPECT_EQ(std::ranges::count(level.distances, 7.0F), 1'024);
    EXPECT_EQ(level.places.size(), 1'024U);
    meter.measure_at_some(level, {});  // and others
    EXPECT_EQ(std::ranges::count(level.distances, 7.0F), 1'024);
    EXPECT_EQ(level.places.size(), 4'096U);
    const double mean = meter.mean_at_a_glance(level);
    meter.glance(level, {});
    EXPECT_DOUBLE_EQ(level.mean, mean);
}

}  // namespace
}  // namespace stipple
