#include "contraction/curvature_contraction.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <set>
#include <vector>

namespace stipple {
namespace {

std::vector<Vec3f> sphere(std::size_t n, float radius, const Vec3f& center) {
    std::vector<Vec3f> points = test::sphere(n).positions;
    for (Vec3f& p : points) p = radius * p + center;
    return points;
}

/// A sphere of radius 1, and one of radius 1 / 4 with its points as close: 16 times fewer.
std::vector<Vec3f> large_and_small(std::size_t large) {
    std::vector<Vec3f> points = sphere(large, 1, Vec3f::Zero());
    for (const Vec3f& p : sphere(large / 16, 0.25F, {10, 0, 0})) points.push_back(p);
    return points;
}

double median(std::vector<float> values) {
    std::ranges::nth_element(values,
                             values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2));
    return static_cast<double>(values[values.size() / 2]);
}

TEST(Bends, AreNoneOnAPlaneAndInASaddle) {
    const auto plane = test::plane(1000).positions;
    EXPECT_LT(median(bends_of(plane, {}).curvatures), 1e-3 / bounds(test::plane(1000)).diagonal());
    std::vector<Vec3f> saddle;
    for (int i = -20; i <= 20; ++i)
        for (int j = -20; j <= 20; ++j)
            saddle.emplace_back(0.01F * static_cast<float>(i), 0.01F * static_cast<float>(j),
                                0.00005F * static_cast<float>(i * i - j * j));
    const double unit = median(bends_of(sphere(5000, 1, Vec3f::Zero()), {}).curvatures);
    EXPECT_LT(median(bends_of(saddle, {}).curvatures), 0.1 * unit);
}

TEST(Bends, GoAsOneOverTheRadius) {
    const double one = median(bends_of(sphere(20'000, 1, Vec3f::Zero()), {}).curvatures);
    EXPECT_NEAR(median(bends_of(sphere(20'000, 0.25F, {1, 2, 3}), {}).curvatures) / one, 4, 0.1);
    // Not as how close the points are.
    EXPECT_NEAR(median(bends_of(sphere(5000, 1, Vec3f::Zero()), {}).curvatures) / one, 1, 0.05);
}

TEST(Bends, AreZeroWhereThereIsNoSurface) {
    const auto zero = [](const std::vector<Vec3f>& points) {
        return std::ranges::all_of(bends_of(points, {}).curvatures,
                                   [](float bend) { return bend == 0; });
    };
    EXPECT_TRUE(zero({}));
    EXPECT_TRUE(zero({{1, 2, 3}}));
    EXPECT_TRUE(zero({{1, 0, 0}, {0.5F, 0, 0}}));
    EXPECT_TRUE(zero(std::vector<Vec3f>(50, Vec3f(1, 2, 3))));
}

TEST(CurvatureContraction, PutsMorePointsOnTheSphereThatBendsMore) {
    const auto points = large_and_small(16'000);
    const std::uint64_t count = 850;
    contract_by_curvature({points}, std::span(&count, 1), {},
                          [](ContractionSnapshot&& s, const RunContext&) {
                              ASSERT_EQ(s.positions.size(), 850U);
                              const auto on_small = std::ranges::count_if(
                                  s.positions, [](const Vec3f& p) { return p.x() > 5; });
                              EXPECT_GT(on_small, 2 * 850 / 17);  // its share of the area
                          },
                          {});
}

TEST(CurvatureContraction, GivesEverySampleASurvivorAndEverySurvivorASample) {
    const auto points = test::sphere(3000, 0.01).positions;
    const std::vector<std::uint64_t> counts = {3000, 1000, 50, 1};
    std::size_t at = 0;
    contract_by_curvature({points}, counts, {},
                          [&](ContractionSnapshot&& s, const RunContext&) {
                              EXPECT_EQ(s.positions.size(), counts[at++]);
                              ASSERT_EQ(s.survivor_of.size(), points.size());
                              const std::set<Index> used(s.survivor_of.begin(),
                                                         s.survivor_of.end());
                              EXPECT_EQ(used.size(), s.positions.size());
                              EXPECT_EQ(*used.rbegin(), s.positions.size() - 1);
                          },
                          {});
    EXPECT_EQ(at, counts.size());
}

TEST(CurvatureContraction, GivesTheNextInputTheQuadricsOfAllThatItsPointsStandFor) {
    const auto points = test::sphere(8000).positions;
    const std::vector<std::uint64_t> counts = {2000, 400};
    ContractionSnapshot base;
    contract_by_curvature({.positions = points, .next = 2000}, counts, {},
                          [&](ContractionSnapshot&& s, const RunContext&) {
                              EXPECT_EQ(s.quadrics.size(), s.positions.size() == 2000 ? 2000U : 0U);
                              if (s.positions.size() == 2000) base = std::move(s);
                          },
                          {});
    ASSERT_EQ(base.quadrics.size(), 2000U);
    // Of planes that touch the sphere: much steeper across it than along it.
    for (std::size_t i = 0; i < base.quadrics.size(); ++i) {
        const Quadric q(base.quadrics[i]);
        const Vec3d out = base.positions[i].cast<double>().normalized();
        const Vec3d along = out.unitOrthogonal();
        const Quadric form = {q.xx, q.xy, q.xz, q.yy, q.yz, q.zz};
        EXPECT_GT(value(form, out), 10 * value(form, along));
    }
    const std::uint64_t count = 400;
    contract_by_curvature({base.positions, base.quadrics, points.size()}, std::span(&count, 1), {},
                          [&](ContractionSnapshot&& s, const RunContext&) {
                              ASSERT_EQ(s.positions.size(), 400U);
                              ASSERT_EQ(s.survivor_of.size(), 2000U);
                              for (const Vec3f& p : s.positions) EXPECT_NEAR(p.norm(), 1, 0.02);
                          },
                          {});
}

}  // namespace
}  // namespace stipple
