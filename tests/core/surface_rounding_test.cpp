#include "pyramid/surface_rounding.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace stipple {
namespace {

/// What a place costs, in squared steps.
double cost_of(const Vec3f& place, const Vec3f& point, const Vec3f& normal, double step) {
    const Vec3d way = (place - point).cast<double>() / step;
    const double across = way.dot(normal.cast<double>());
    return across * across + 0.02 * way.squaredNorm();
}

TEST(SurfaceRounding, GoesToTheBestOf27Places) {
    const PointCloud cloud = test::sphere(1'003);  // positions are normals
    for (const double step : {0.003, 0.1, 0.7}) {
        std::vector<Vec3f> rounded(cloud.size());
        std::vector<NormalAndBend> normals;
        for (const Vec3f& p : cloud.positions) normals.push_back({p, 0});
        round_to_surface(cloud.positions, normals, step, rounded.data());
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            const Vec3f& p = cloud.positions[i];
            double least = std::numeric_limits<double>::infinity();
            for (int place = 0; place < 27; ++place) {
                Vec3f at;
                for (int axis = 0, rest = place; axis < 3; ++axis, rest /= 3) {
                    const double steps = std::floor(static_cast<double>(p[axis]) / step + 0.5);
                    at[axis] = static_cast<float>(step * (steps + rest % 3 - 1));
                }
                least = std::min(least, cost_of(at, p, p, step));
            }
            ASSERT_NEAR(cost_of(rounded[i], p, p, step), least, 1e-4) << i;
        }
    }
}

TEST(SurfaceRounding, OnAPlaneAlongTheGridIsToTheNearestPlace) {
    const std::vector<Vec3f> points = {{0.9F, -1.2F, 0.0F}, {2.4F, 7.6F, 3.0F}};
    const std::vector<NormalAndBend> normals(2);
    std::vector<Vec3f> rounded(2);
    round_to_surface(points, normals, 1.0, rounded.data());
    EXPECT_EQ(rounded, (std::vector<Vec3f>{{1, -1, 0}, {2, 8, 3}}));
}

TEST(SurfaceRounding, GoesOutOfACurvedSurfaceByHalfAStepAtMost) {
    const std::vector<Vec3f> points(3, Vec3f(0, 0, 5));
    const std::vector<NormalAndBend> normals = {
        {Vec3f::UnitZ(), -0.1F}, {Vec3f::UnitZ(), -9}, {-Vec3f::UnitZ(), 9}};
    std::vector<Vec3f> rounded(3);
    round_to_surface(points, normals, 0.8, rounded.data());  // to 4.8, 5.6, ...
    EXPECT_NEAR(rounded[0].z(), 4.8, 1e-6);                  // from 5.16
    EXPECT_NEAR(rounded[1].z(), 5.6, 1e-6);                  // from 5.4
    EXPECT_NEAR(rounded[2].z(), 5.6, 1e-6);
}

}  // namespace
}  // namespace stipple
