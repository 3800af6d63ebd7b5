#include "analysis/planar_hull.hpp"

#include <gtest/gtest.h>
#include <vector>

namespace stipple {
namespace {

using Points = std::vector<Eigen::Vector2f>;

/// The corners of a square of side 2 around a place.
Points square_around(const Eigen::Vector2f& place) {
    Points corners;
    for (const float x : {-1.0F, 1.0F})
        for (const float y : {-1.0F, 1.0F}) corners.push_back(place + Eigen::Vector2f(x, y));
    return corners;
}

TEST(WayToHull, IsZeroWithin) {
    EXPECT_EQ(way_to_hull(square_around({0, 0})), 0);
    EXPECT_EQ(way_to_hull(square_around({0.9F, -0.9F})), 0);
    EXPECT_EQ(way_to_hull(Points{{3, 1}, {0, 0}, {4, 1}}), 0);   // one of the points
    EXPECT_EQ(way_to_hull(Points{{-3, 0}, {1, 0}, {2, 0}}), 0);  // between two
}

TEST(WayToHull, IsThatToASideOrACorner) {
    EXPECT_FLOAT_EQ(way_to_hull(square_around({3, 0.5F})), 2);
    EXPECT_FLOAT_EQ(way_to_hull(square_around({-4, 5})), 5);
    EXPECT_FLOAT_EQ(way_to_hull(square_around({1.25F, 0})), 0.25F);
}

TEST(WayToHull, OfPointsOnALineAndOfOne) {
    EXPECT_FLOAT_EQ(way_to_hull(Points{{2, -3}, {2, 5}, {2, 1}}), 2);
    EXPECT_FLOAT_EQ(way_to_hull(Points{{3, 0}, {2, 0}}), 2);  // it goes through the origin
    EXPECT_FLOAT_EQ(way_to_hull(Points{{3, 4}, {3, 4}}), 5);
}

}  // namespace
}  // namespace stipple
