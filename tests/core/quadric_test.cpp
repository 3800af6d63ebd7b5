#include "contraction/quadric.hpp"

#include <gtest/gtest.h>

namespace stipple {
namespace {

TEST(Quadric, MeasuresTheSquaredDistanceToAPlane) {
    Quadric q;
    add_plane(q, Vec3d(2, 1, 2) / 3, {1, 1, 1}, 4);
    EXPECT_NEAR(value(q, {1, 1, 1}), 0, 1e-12);
    EXPECT_NEAR(value(q, Vec3d(1, 1, 1) + Vec3d(2, 1, 2)), 4 * 9, 1e-12);
    EXPECT_NEAR(value(q, Vec3d(1, 1, 1) + Vec3d(1, -2, 0)), 0, 1e-12);  // along the plane
}

TEST(Quadric, IsLeastWhereThreePlanesOfACubeMeet) {
    Quadric q;
    add_plane(q, Vec3d::UnitX(), {3, 0.5, 0.5}, 1);
    add_plane(q, Vec3d::UnitY(), {0.5, 4, 0.5}, 2);
    add_plane(q, Vec3d::UnitZ(), {0.5, 0.5, 5}, 3);
    Vec3d y;
    ASSERT_TRUE(minimiser(q, y));
    EXPECT_NEAR((y - Vec3d(3, 4, 5)).norm(), 0, 1e-14);
    EXPECT_NEAR(value(q, y), 0, 1e-12);
}

TEST(Quadric, HasNoSingleMinimiserOnOnePlaneOrTwo) {
    Quadric q;
    Vec3d y;
    EXPECT_FALSE(minimiser(q, y));
    add_plane(q, Vec3d(1, 1, 0).normalized(), Vec3d::Zero(), 1);
    EXPECT_FALSE(minimiser(q, y));
    add_plane(q, Vec3d::UnitZ(), Vec3d::Zero(), 1);
    EXPECT_FALSE(minimiser(q, y));
}

TEST(Quadric, OfPointsIsLeastAtTheirCentroid) {
    Quadric q;
    add_point(q, {0, 0, 0}, 1);
    add_point(q, {4, 0, 8}, 3);
    Vec3d y;
    ASSERT_TRUE(minimiser(q, y));
    EXPECT_NEAR((y - Vec3d(3, 0, 6)).norm(), 0, 1e-14);
    EXPECT_NEAR(value(q, y), 45 + 3 * 5, 1e-12);
}

TEST(Quadric, IsTheSameFunctionInAnotherUnit) {
    Quadric q;
    add_plane(q, Vec3d(1, 2, -2) / 3, {0.5, 0, 1}, 3);
    add_point(q, {0.25, -1, 2}, 0.5);
    const Quadric large(in_unit(StoredQuadric(q), 4));
    for (const Vec3d& y : {Vec3d(0, 0, 0), Vec3d(1, 2, 3), Vec3d(-0.5, 0.25, 8)})
        EXPECT_NEAR(value(large, 4 * y), 16 * value(q, y), 1e-5 * value(large, 4 * y));
}

TEST(Quadric, IsTheSameFunctionFromAnotherReference) {
    Quadric q;
    add_plane(q, Vec3d(2, 1, 2) / 3, {1, 2, 3}, 4);
    add_point(q, {1, -1, 2}, 0.5);
    const Vec3d reference(0.5, 2, -1), y(3, 1, 4);
    EXPECT_NEAR(value(referred_to(q, reference), y - reference), value(q, y), 1e-12);
}

}  // namespace
}  // namespace stipple
