#include "error/worst_samples.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace stipple {
namespace {

/// Places of a plane, and how far they are from another one above it.
class WorstSamples : public ::testing::Test {
protected:
    static constexpr double kApart = 0.1;
    static constexpr std::size_t kForged = 777;

    std::vector<Vec3f> plane_ = test::plane(4'000).positions;
    std::vector<Vec3f> above_ = raised(plane_);
    PointTree tree_{plane_, PointTree::Leaves::Compact, {}};
    PointTree tree_above_{above_, PointTree::Leaves::Compact, {}};
    FootFinder on_plane_{plane_, tree_, {}}, on_above_{above_, tree_above_, {}};
    std::vector<Vec3f> places_ = plane_;
    std::vector<double> distances_ = std::vector<double>(plane_.size(), kApart);

    static std::vector<Vec3f> raised(std::vector<Vec3f> points) {
        for (Vec3f& p : points) p.z() += static_cast<float>(kApart);
        return points;
    }
    void confirm(const FootFinder* drawn_on) {
        confirm_worst(places_, distances_, on_above_, drawn_on, plane_, tree_, {});
    }
    double max() const { return *std::ranges::max_element(distances_); }
};

TEST_F(WorstSamples, LeaveADistanceThatIsRight) {
    confirm(&on_plane_);
    EXPECT_NEAR(max(), kApart, 1e-6);
    EXPECT_EQ(places_, plane_);
}

TEST_F(WorstSamples, AreMeasuredAgain) {
    for (std::size_t i = 0; i < 20; ++i) distances_[kForged + 10 * i] = 5 + i;
    confirm(nullptr);
    EXPECT_NEAR(max(), kApart, 1e-6);
}

TEST_F(WorstSamples, MoveToAPointWhereTheyAreNotOnTheirSurface) {
    const Vec3f stray = plane_[kForged] - Vec3f(0, 0, 0.02F);  // about two spacings below
    places_[kForged] = stray;
    distances_[kForged] = kApart + 0.02;
    confirm(&on_plane_);
    EXPECT_EQ(places_[kForged], plane_[kForged]);
    EXPECT_NEAR(max(), kApart, 1e-6);
}

TEST_F(WorstSamples, StayWhereTheyArePointsThemselves) {
    const Vec3f stray = plane_[kForged] - Vec3f(0, 0, 0.02F);
    places_[kForged] = stray;
    distances_[kForged] = kApart + 0.02;
    confirm(nullptr);
    EXPECT_EQ(places_[kForged], stray);
    EXPECT_NEAR(max(), kApart + 0.02, 1e-6);
}

/// A plane with a ball of points in it: nothing within has a normal.
TEST_F(WorstSamples, AreNoFartherThanOthersAndTheWayToThem) {
    std::vector<Vec3f> knot = plane_;
    for (const Vec3f& p : test::sphere(300).positions)
        knot.push_back(Vec3f(0.5F, 0.5F, 0) + 0.03F * p);
    const PointTree tree(knot, PointTree::Leaves::Compact, {});
    const FootFinder surface(knot, tree, {});
    std::vector<Vec3f> places;
    for (float x = 0.4F; x < 0.6F; x += 0.002F) places.emplace_back(x, 0.5F, 0.01F);
    std::vector<double> found(places.size());
    surface.find(places, [&](std::size_t i, const Foot& foot) { found[i] = foot.distance; }, {});
    const std::vector<double> confirmed = confirmed_distances(surface, places, {});
    for (std::size_t i = 0; i < places.size(); ++i) {
        EXPECT_LE(confirmed[i], found[i]);
        EXPECT_GE(confirmed[i], 0);
    }
    EXPECT_NEAR(confirmed.front(), 0.01, 1e-3);
}

/// A limb thinner than its points are apart, around which walks come to rest anywhere.
class ThinLimb : public ::testing::Test {
protected:
    std::vector<Foot> feet_of(const std::vector<Vec3f>& queries) const {
        std::vector<Foot> feet(queries.size());
        surface_.find(queries, [&](std::size_t i, const Foot& foot) { feet[i] = foot; }, {});
        return feet;
    }

private:
    float unit() { return std::uniform_real_distribution<float>(0, 1)(random_); }
    Vec3f beside_axis(float radius) {
        const float along = 4 * unit(), angle = 6.2831853F * unit();
        return {along, radius * std::cos(angle), radius * std::sin(angle)};
    }
    std::vector<Vec3f> limb_of(int points) {
        std::vector<Vec3f> limb;
        for (int i = 0; i < points; ++i) limb.push_back(beside_axis(0.04F + 0.02F * unit()));
        return limb;
    }
    std::vector<Vec3f> around(int places) {
        std::vector<Vec3f> around;
        for (int i = 0; i < places; ++i) around.push_back(beside_axis(0.055F));
        return around;
    }

    std::mt19937 random_{1};

protected:
    std::vector<Vec3f> limb_ = limb_of(400), places_ = around(2'000);
    PointTree tree_{limb_, PointTree::Leaves::Compact, {}};
    FootFinder surface_{limb_, tree_, {}};
    std::vector<Foot> found_ = feet_of(places_);
    std::vector<double> confirmed_ = confirmed_distances(surface_, places_, {});
};

TEST_F(ThinLimb, IsNoFartherThanByTheNearestSample) {
    std::vector<Vec3f> nearest;
    for (const Vec3f& q : places_)
        nearest.push_back(
            *std::ranges::min_element(limb_, {}, [&](const Vec3f& p) { return (p - q).norm(); }));
    const std::vector<Foot> of_nearest = feet_of(nearest);
    unsigned farther = 0;
    for (std::size_t i = 0; i < places_.size(); ++i) {
        const double most = (places_[i] - nearest[i]).norm() + of_nearest[i].distance;
        if (found_[i].distance > 1.1 * most) ++farther;
        EXPECT_LE(confirmed_[i], most + 1e-6) << i;
    }
    EXPECT_GT(farther, 10U);
}

TEST_F(ThinLimb, IsNoFartherFromAKnotThanFromThePlaceBeside) {
    constexpr double kWay = 0.1;  // in h
    std::vector<Vec3f> beside = places_;
    for (std::size_t i = 0; i < beside.size(); ++i)
        beside[i].x() += static_cast<float>(kWay * found_[i].h);
    const std::vector<Foot> feet = feet_of(beside);
    unsigned farther = 0;
    for (std::size_t i = 0; i < places_.size(); ++i) {
        if (found_[i].on_surface() || !feet[i].is_fixed()) continue;
        const double most = feet[i].distance + kWay * found_[i].h;
        if (found_[i].distance > 1.1 * most) ++farther;
        EXPECT_LE(confirmed_[i], most + 1e-6) << i;
    }
    EXPECT_GT(farther, 3U);
}

TEST_F(WorstSamples, OfAFewSamplesAreNotLookedAt) {
    places_.resize(400);
    distances_.assign(400, 1.0);
    confirm(nullptr);
    EXPECT_EQ(max(), 1.0);
}

}  // namespace
}  // namespace stipple
