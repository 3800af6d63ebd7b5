#include "contraction/contraction.hpp"

#include "contraction/contraction_quadrics.hpp"
#include "contraction/contraction_relaxation.hpp"
#include "support/oracles.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

namespace stipple {
namespace {

/// n points on the ellipsoid of half axes 1, 0.7 and 0.4, and the quadrics of its tangent planes.
struct Ellipsoid {
    std::vector<Vec3f> points;
    std::vector<StoredQuadric> quadrics;  ///< relative to the points, in units of `scale`
    double scale = 1;

    explicit Ellipsoid(std::size_t n) {
        const Vec3f axes(1.0F, 0.7F, 0.4F);
        for (const Vec3f& p : test::sphere(n).positions)
            points.push_back(p.cwiseProduct(axes) + Vec3f(0, 0, 1e-4F));
        scale = contraction_scale(points, {});
        for (const Vec3f& p : test::sphere(n).positions) {
            const Vec3d normal = p.cwiseQuotient(axes).cast<double>();
            const double area = normal.norm();  // of what an even part of the sphere becomes
            Quadric q;
            add_plane(q, normal.normalized(), Vec3d::Zero(), area);
            add_point(q, Vec3d::Zero(), kPointTerm * area);
            quadrics.emplace_back(q);
        }
    }

    /// What the samples' quadrics say of the survivors that stand for them.
    double error(const ContractionSnapshot& s) const {
        double sum = 0;
        for (std::size_t i = 0; i < points.size(); ++i) {
            const Vec3f& survivor = s.positions[s.survivor_of[i]];
            sum += value(Quadric(quadrics[i]), scale * (survivor - points[i]).cast<double>());
        }
        return sum;
    }
};

TEST(ContractionQuadrics, OfEdgesInAPlaneAreZeroInIt) {
    const std::vector<Vec3d> neighbors = {{1, 0, 0}, {0, 2, 0}, {-1, 1, 0}};
    Quadric q;
    add_edges(q, neighbors, {Vec3d::UnitZ()}, 5);
    const double point_term = 5 * kPointTerm;
    EXPECT_NEAR(value(q, {3, 4, 0}), point_term * 25, 1e-12);
    EXPECT_NEAR(value(q, {0, 0, 2}), (5 + point_term) * 4, 1e-12);
}

TEST(ContractionQuadrics, OfAnEdgeThatLeavesTheTangentPlaneTiltWithIt) {
    // e = (1, 0, 1), n = z: the plane is spanned by e and e x n = (0, -1, 0).
    const std::vector<Vec3d> neighbors = {{1, 0, 1}};
    Quadric q;
    add_edges(q, neighbors, {Vec3d::UnitZ()}, 1);
    const double point_term = kPointTerm + 0.5 * kRoughnessTerm;  // a slope of 45 degrees
    EXPECT_NEAR(value(q, {2, 7, 2}), point_term * 57, 1e-12);
    EXPECT_NEAR(value(q, {1, 0, -1}), 2 + point_term * 2, 1e-12);
}

TEST(ContractionQuadrics, KnowABorderFromTheInside) {
    std::vector<Vec3d> all, half;
    for (int i = 0; i < 32; ++i) {
        const double angle = i * std::numbers::pi / 16;
        const Vec3d e(std::cos(angle), std::sin(angle), 0);
        all.push_back(e);
        if (e.x() < 1e-9) half.push_back(e);
    }
    EXPECT_FALSE(may_be_on_border(all, Vec3d::UnitZ()));
    EXPECT_TRUE(may_be_on_border(half, Vec3d::UnitZ()));
    EXPECT_FALSE(with_border(Vec3d::UnitZ(), all).border);
    const Tangent tangent = with_border(Vec3d::UnitZ(), half);
    EXPECT_TRUE(tangent.border);
    Quadric q;
    add_edges(q, half, tangent, 1);
    const double along = value(q, {0, 1, 0}), across = value(q, {1, 0, 0});
    EXPECT_NEAR(along, kPointTerm, 1e-9);  // free to slide along the border
    EXPECT_GT(across, 0.05);               // not to leave it
}

TEST(ContractionQuadrics, LookCloselyAtEveryGapThatIsABorder) {
    for (int turn = 0; turn < 360; ++turn) {
        std::vector<Vec3d> neighbors;
        for (int angle = 0; angle <= 190; ++angle) {  // a gap of 170 degrees
            const double at = (angle + turn) * std::numbers::pi / 180;
            neighbors.emplace_back(std::cos(at), std::sin(at), 0);
        }
        EXPECT_TRUE(may_be_on_border(neighbors, Vec3d::UnitZ())) << turn;
    }
}

TEST(ContractionQuadrics, TangentsSurvivePacking) {
    for (const Vec3f& p : test::sphere(500).positions) {
        const Tangent tangent = {p.cast<double>(), 4.0 * static_cast<double>(p.x() + 1), p.y() > 0};
        const Tangent back = unpacked(packed(tangent));
        EXPECT_LT(back.normal.cross(tangent.normal).norm(), 5e-4);
        EXPECT_NEAR(std::remainder(back.border_angle - tangent.border_angle, 2 * std::numbers::pi),
                    0, 0.1);
        EXPECT_EQ(back.border, tangent.border);
    }
}

TEST(ContractionQuadrics, HoldTheGradientOfAFeature) {
    // f = 2 x - y.
    const std::vector<Vec3d> neighbors = {{1, 0, 0}, {0, 2, 0}, {-1, 1, 0}, {1, 1, 0}};
    const std::vector<float> steps = {2, -2, -3, 1};
    Quadric q;
    add_gradients(q, neighbors, steps, 1, Vec3d::UnitZ(), 3);
    EXPECT_NEAR(value(q, {1, 0, 9}), 3 * 4, 1e-12);
    EXPECT_NEAR(value(q, {1, 2, 0}), 0, 1e-12);
}

TEST(Contraction, ComesWithinThreePercentOfThePapersQueue) {
    const Ellipsoid e(800);
    for (const std::uint64_t count : {300U, 100U, 30U}) {
        double error = 0;
        contract(e.points, e.quadrics, std::span(&count, 1), {},
                 [&](ContractionSnapshot&& s) { error = e.error(s); }, {});
        const double oracle = e.error(
            test::contract_by_queue(e.points, e.quadrics, e.scale, count, ContractionOptions{}.k));
        EXPECT_LT(error, 1.03 * oracle) << count;
        EXPECT_GT(error, 0.8 * oracle) << count;
    }
}

TEST(Contraction, TakesFewRoundsWhereCostsGrowAlongACurve) {
    std::vector<Vec3f> points;  // on a cone, ever farther from each other
    for (int i = 0; i < 4'000; ++i) {
        const double t = 1e-3 * i;
        points.push_back(Vec3d(t * std::cos(2 * t), t * std::sin(2 * t), t).cast<float>());
    }
    int rounds = 0;
    const std::uint64_t count = 10;
    contract(points, {}, std::span(&count, 1), {}, [](ContractionSnapshot&&) {},
             {.stop = {}, .progress = [&](double) { ++rounds; }});
    EXPECT_LT(rounds, 400);
}

TEST(Contraction, EverySampleHasASurvivorAndEverySurvivorASample) {
    const auto points = test::sphere(3000, 0.01).positions;
    const std::vector<std::uint64_t> counts = {3000, 1000, 50, 1};
    std::size_t at = 0;
    contract(points, {}, counts, {},
             [&](ContractionSnapshot&& s) {
                 EXPECT_EQ(s.positions.size(), counts[at++]);
                 ASSERT_EQ(s.survivor_of.size(), points.size());
                 const std::set<Index> used(s.survivor_of.begin(), s.survivor_of.end());
                 EXPECT_EQ(used.size(), s.positions.size());
                 EXPECT_EQ(*used.rbegin(), s.positions.size() - 1);
             },
             {});
    EXPECT_EQ(at, counts.size());
}

TEST(Contraction, SequencesGiveEveryCount) {
    const auto points = test::sphere(700, 0.01).positions;
    const std::vector<std::uint64_t> counts = {400, 123, 1};
    std::vector<ContractionPair> sequence;
    std::vector<ContractionSnapshot> snapshots;
    contract(points, {}, counts, {.placement = Placement::EndPoint, .sequence = &sequence},
             [&](ContractionSnapshot&& s) { snapshots.push_back(std::move(s)); }, {});
    ASSERT_EQ(sequence.size(), points.size() - 1);
    for (std::size_t s = 0; s < counts.size(); ++s) {
        std::set<Index> left;
        for (Index i = 0; i < points.size(); ++i) left.insert(i);
        for (std::size_t step = 0; step < points.size() - counts[s]; ++step) {
            EXPECT_TRUE(left.contains(sequence[step].first));
            EXPECT_EQ(left.erase(sequence[step].second), 1U);
        }
        const auto& samples = snapshots[s].samples;
        EXPECT_EQ(left, std::set<Index>(samples.begin(), samples.end()));
    }
}

TEST(Relaxation, IsBetterThanContractionAlone) {
    const Ellipsoid e(4000);
    const std::uint64_t count = 200;
    ContractionSnapshot s;
    contract(e.points, e.quadrics, std::span(&count, 1), {},
             [&](ContractionSnapshot&& greedy) { s = std::move(greedy); }, {});
    const double greedy = e.error(s);
    SharedSamples samples{e.points, e.quadrics, s.survivor_of};
    for (Vec3f& p : samples.positions) p *= static_cast<float>(e.scale);
    for (Vec3f& p : s.positions) p *= static_cast<float>(e.scale);
    relax(samples, s.positions, 2, {});
    for (Vec3f& p : s.positions) p /= static_cast<float>(e.scale);
    s.survivor_of = samples.survivor_of;
    EXPECT_LT(e.error(s), 0.95 * greedy);
}

TEST(Relaxation, LeavesEverySurvivorASample) {
    // Two survivors at one place, and all samples nearer to a third.
    SharedSamples samples;
    for (int i = 0; i < 9; ++i) {
        samples.positions.emplace_back(static_cast<float>(i), 0.0F, 0.0F);
        Quadric q;
        add_point(q, Vec3d::Zero(), 1);
        samples.quadrics.emplace_back(q);
        samples.survivor_of.push_back(static_cast<Index>(i < 7 ? 0 : i - 6));
    }
    std::vector<Vec3f> survivors = {{3, 0, 0}, {50, 0, 0}, {50, 0, 0}};
    relax(samples, survivors, 3, {});
    EXPECT_EQ(std::set<Index>(samples.survivor_of.begin(), samples.survivor_of.end()).size(), 3U);
}

TEST(Relaxation, FindsTheEvenPartOfALine) {
    SharedSamples samples;
    for (int i = 0; i < 30; ++i) {
        samples.positions.emplace_back(static_cast<float>(i), 0.0F, 0.0F);
        Quadric q;
        add_point(q, Vec3d::Zero(), 1);
        samples.quadrics.emplace_back(q);
        samples.survivor_of.push_back(i < 2 ? 0 : i < 4 ? 1 : 2);
    }
    std::vector<Vec3f> survivors = {{0, 0, 0}, {2, 0, 0}, {16, 0, 0}};
    relax(samples, survivors, 100, {});
    EXPECT_NEAR(survivors[0].x(), 4.5, 2);
    EXPECT_NEAR(survivors[1].x(), 14.5, 2);
    EXPECT_NEAR(survivors[2].x(), 24.5, 2);
}

}  // namespace
}  // namespace stipple
