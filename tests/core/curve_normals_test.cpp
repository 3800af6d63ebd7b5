#include "curve_normals.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>

#include <cmath>

// Normals by the points beside each other on a curve (core/src/curve_normals.hpp).

namespace stipple {
namespace {

std::vector<Vec3f> normals_of(const PointCloud& cloud, unsigned threads = 1) {
    RunContext context;
    context.threads = threads;
    return curve_normals(PointTree(cloud.positions, PointTree::Leaves::Quick, context), context);
}

TEST(CurveNormals, AreThoseOfASphere) {
    const PointCloud cloud = test::sphere(20'003);
    const std::vector<Vec3f> normals = normals_of(cloud);
    ASSERT_EQ(normals.size(), cloud.size());
    double off = 0;
    for (std::size_t i = 0; i < normals.size(); ++i) {
        EXPECT_NEAR(normals[i].norm(), 1, 1e-5);
        const double cosine = std::abs(normals[i].dot(cloud.positions[i]));
        EXPECT_GT(cosine, 0.95) << i;  // where the curve leaves a corner, from one side
        off += std::acos(std::min(1.0, cosine)) / static_cast<double>(normals.size());
    }
    EXPECT_LT(off, 0.02);  // a degree
}

TEST(CurveNormals, AreUpWhereThereIsNoPlane) {
    for (const std::size_t n : {1U, 2U, 40U})
        for (const Vec3f& normal : normals_of(test::line(n)))
            EXPECT_EQ(normal, Vec3f(Vec3f::UnitZ())) << n;
}

TEST(CurveNormals, OfThreePointsAreThatOfTheirPlane) {
    PointCloud cloud;
    cloud.positions = {{5, 1, 0}, {5, 0, 1}, {5, -1, -1}};
    for (const Vec3f& normal : normals_of(cloud)) EXPECT_NEAR(std::abs(normal.x()), 1, 1e-5);
}

TEST(CurveNormals, AreTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::sphere(5'001, 0.02);
    EXPECT_EQ(normals_of(cloud, 1), normals_of(cloud, 3));
}

}  // namespace
}  // namespace stipple
