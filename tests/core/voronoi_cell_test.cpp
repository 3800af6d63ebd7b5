#include "rendering/voronoi_cell.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <set>
#include <vector>

namespace stipple {
namespace {

using Vec2d = Eigen::Vector2d;

PlanarPlaces nearest_first(std::vector<Vec2d> places) {
    std::ranges::sort(places, {}, [](const Vec2d& p) { return p.squaredNorm(); });
    PlanarPlaces flat;
    flat.reset(places.size());
    for (std::size_t i = 0; i < places.size(); ++i) {
        flat.x[i] = static_cast<float>(places[i].x());
        flat.y[i] = static_cast<float>(places[i].y());
        flat.length_sq[i] = flat.x[i] * flat.x[i] + flat.y[i] * flat.y[i];
    }
    return flat;
}

Vec2d place(const PlanarPlaces& places, std::size_t i) {
    return {places.x[i], places.y[i]};
}

/// Neighbours of the corners that are nearer to the origin than to any other place: all pairs are
/// tried.
std::set<std::pair<int, int>> corners_by_trying(const PlanarPlaces& places) {
    std::set<std::pair<int, int>> corners;
    for (std::size_t i = 0; i < places.x.size(); ++i) {
        for (std::size_t j = i + 1; j < places.x.size(); ++j) {
            const Vec2d a = place(places, i), b = place(places, j);
            Eigen::Matrix2d m;
            m << a.x(), a.y(), b.x(), b.y();
            if (std::abs(m.determinant()) < 1e-12) continue;
            const Vec2d at = m.inverse() * Vec2d(0.5 * a.squaredNorm(), 0.5 * b.squaredNorm());
            bool is_nearest = true;
            for (std::size_t k = 0; k < places.x.size(); ++k) {
                const Vec2d q = place(places, k);
                is_nearest &= k == i || k == j || at.dot(q) <= 0.5 * q.squaredNorm();
            }
            if (is_nearest) corners.emplace(static_cast<int>(i), static_cast<int>(j));
        }
    }
    return corners;
}

std::set<std::pair<int, int>> corners_of(const VoronoiCell& cell) {
    std::set<std::pair<int, int>> corners;
    for (const VoronoiCell::Edge& edge : cell.edges()) {
        if (edge.next != VoronoiCell::kOpen) corners.insert(std::minmax(edge.neighbor, edge.next));
    }
    return corners;
}

TEST(VoronoiCell, HasTheCornersThatTryingAllPairsFinds) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> coordinate(-1, 1);
    VoronoiCell cell;
    unsigned closed = 0;
    for (int run = 0; run < 2'000; ++run) {
        std::vector<Vec2d> places(3 + random() % 30);
        for (Vec2d& p : places) p = {coordinate(random), coordinate(random)};
        const PlanarPlaces flat = nearest_first(places);
        cell.find(flat);
        const auto expected = corners_by_trying(flat);
        EXPECT_EQ(corners_of(cell), expected) << run;
        closed += cell.is_closed() ? 1 : 0;
        EXPECT_EQ(cell.is_closed(), cell.edges().size() == expected.size()) << run;
        for (const VoronoiCell::Edge& edge : cell.edges()) {
            const Vec2d n = place(flat, static_cast<std::size_t>(edge.neighbor));
            bool is_direct = true;
            for (std::size_t k = 0; k < flat.x.size(); ++k) {
                const Vec2d q = place(flat, k);
                is_direct &= q == n || q.isZero() || n.dot(q) < q.squaredNorm();
            }
            EXPECT_EQ(edge.is_direct, is_direct) << run;
        }
    }
    EXPECT_GT(closed, 1'500U);
}

TEST(VoronoiCell, OfASquareLatticeIsASquare) {
    std::vector<Vec2d> places;
    for (int x = -2; x <= 2; ++x)
        for (int y = -2; y <= 2; ++y)
            if (x != 0 || y != 0) places.emplace_back(x, y);
    VoronoiCell cell;
    cell.find(nearest_first(places));
    EXPECT_TRUE(cell.is_closed());
    unsigned direct = 0;
    for (const VoronoiCell::Edge& edge : cell.edges()) {
        direct += edge.is_direct ? 1 : 0;
        EXPECT_NEAR(edge.corner.norm(), std::sqrt(0.5), 1e-6);
    }
    EXPECT_EQ(direct, 4U);
}

TEST(VoronoiCell, OfPlacesOnACircleTouchesAll) {
    constexpr int kPlaces = 40;  // more than what is tried first
    std::vector<Vec2d> places;
    for (int i = 0; i < kPlaces; ++i) {
        const double angle = 2 * std::numbers::pi * i / kPlaces;
        places.emplace_back(std::cos(angle), std::sin(angle));
    }
    VoronoiCell cell;
    cell.find(nearest_first(places));
    EXPECT_TRUE(cell.is_closed());
    EXPECT_EQ(cell.edges().size(), std::size_t{kPlaces});
    for (const VoronoiCell::Edge& edge : cell.edges())
        EXPECT_NEAR(edge.corner.norm(), 0.5 / std::cos(std::numbers::pi / kPlaces), 1e-3);
}

TEST(VoronoiCell, IsOpenWhereNoPlaceEndsIt) {
    VoronoiCell cell;
    cell.find(nearest_first({{1, 0}, {0, 2}, {3, 3}}));
    EXPECT_FALSE(cell.is_closed());
    EXPECT_EQ(corners_of(cell), (std::set<std::pair<int, int>>{{0, 1}}));
    cell.find(nearest_first({{1, 0}, {-1, 0}, {2, 0}}));
    EXPECT_FALSE(cell.is_closed());
    cell.find(nearest_first({}));
    EXPECT_TRUE(cell.edges().empty());
    EXPECT_FALSE(cell.is_closed());
}

TEST(VoronoiCell, LeavesOutPlacesAtTheOriginAndCountsThoseAtOnePlaceOnce) {
    VoronoiCell cell;
    const PlanarPlaces places =
        nearest_first({{0, 0}, {1, 0}, {1, 0}, {0, 1}, {-1, 0}, {0, -1}, {0, 0}});
    cell.find(places);
    EXPECT_TRUE(cell.is_closed());
    EXPECT_EQ(cell.edges().size(), 4U);
    for (const VoronoiCell::Edge& edge : cell.edges()) {
        EXPECT_TRUE(edge.is_direct);
        EXPECT_GT(places.length_sq[static_cast<std::size_t>(edge.neighbor)], 0.0F);
    }
}

}  // namespace
}  // namespace stipple
