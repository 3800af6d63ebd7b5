#include "stipple/lod_error_meter.hpp"

#include "stipple/simplify.hpp"
#include "stipple/surface_error.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace stipple {
namespace {

PointCloud bumpy_sphere(std::size_t points) {
    PointCloud cloud = test::sphere(points);
    for (Vec3f& p : cloud.positions) p *= 1 + 0.05F * std::sin(9 * p.x()) * std::cos(7 * p.y());
    return cloud;
}

TEST(LodErrorMeter, AgreesWithManySamples) {
    // With fewer than 40,000 points places are drawn on the surface.
    for (const std::size_t points : {20'000U, 60'000U}) {
        const PointCloud source = bumpy_sphere(points);
        LodErrorMeter meter(source);
        for (const std::uint64_t count : {500U, 4'000U}) {
            const PointCloud level =
                simplify(source, {.method = Method::Hierarchical, .points = count});
            const SurfaceError error = meter.measure(level), many = measure_error(source, level);
            EXPECT_GE(error.forward.samples, 8'192U);
            EXPECT_NEAR(error.forward.mean, many.forward.mean, 0.03 * many.forward.mean)
                << count << " of " << points;
            EXPECT_LE(error.forward.mean_confidence, 0.02 * error.forward.mean);
            EXPECT_LE(error.max(), 1.01 * many.max());
            EXPECT_EQ(error.diagonal, many.diagonal);
            EXPECT_EQ(error.candidate_diagonal, many.candidate_diagonal);
        }
    }
}

TEST(LodErrorMeter, IsTheSameForAnyNumberOfThreads) {
    const PointCloud source = bumpy_sphere(50'000);
    const PointCloud level = simplify(source, {.method = Method::Hierarchical, .points = 3'000});
    const RunContext one{.threads = 1}, eight{.threads = 8};
    const SurfaceError a = LodErrorMeter(source, one).measure(level, one);
    const SurfaceError b = LodErrorMeter(source, eight).measure(level, eight);
    EXPECT_EQ(a.forward.mean, b.forward.mean);
    EXPECT_EQ(a.forward.samples, b.forward.samples);
    EXPECT_EQ(a.backward.mean, b.backward.mean);
    EXPECT_EQ(a.max(), b.max());
}

TEST(LodErrorMeter, MeasuresOnePoint) {
    PointCloud one;
    one.positions = {{1, 2, 3}};
    EXPECT_EQ(LodErrorMeter(one).measure(one).max(), 0);
    const SurfaceError error = LodErrorMeter(bumpy_sphere(1'000)).measure(one);
    EXPECT_TRUE(std::isfinite(error.max()));
    EXPECT_GT(error.forward.mean, 1);
}

TEST(LodErrorMeter, RefusesCloudsWithoutPoints) {
    test::expect_refused("no points", [] { LodErrorMeter meter{PointCloud()}; });
    LodErrorMeter meter(bumpy_sphere(100));
    test::expect_refused("no points", [&] { meter.measure({}); });
}

}  // namespace
}  // namespace stipple
