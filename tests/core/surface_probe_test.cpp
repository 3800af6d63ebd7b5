#include "error/surface_probe.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace stipple {
namespace {

/// So many points a side of a square from the origin on.
std::vector<Vec3f> square(int points, float side) {
    const float spacing = side / static_cast<float>(points - 1);
    std::vector<Vec3f> square;
    for (int x = 0; x < points; ++x)
        for (int y = 0; y < points; ++y)
            square.emplace_back(spacing * static_cast<float>(x), spacing * static_cast<float>(y),
                                0.0F);
    return square;
}

TEST(ProbedSurface, HasNoPlacesBeyondItsBorder) {
    const std::vector<Vec3f> points = square(17, 1);
    for (const Reading reading : {Reading::Confirmed, Reading::ByTheLetter}) {
        const ProbedSurface surface(points, reading, {});
        const PlacesAround around = surface.places_around(points, 1.2F, 40, 0, {});
        EXPECT_GT(around.places.size(), 20 * points.size());
        float beyond = 0, beside = 1;
        for (const Vec3f& place : around.places)
            for (const float x : {place.x(), place.y()}) {
                beyond = std::max({beyond, -x, x - 1});
                if (x != 0) beside = std::min(beside, std::abs(x));
            }
        EXPECT_LT(beyond, 0.02F);
        EXPECT_LT(beside, 1e-2F);  // but up to it
    }
}

TEST(ProbedSurface, EndsAtItsBorder) {
    const std::vector<Vec3f> points = square(41, 1);
    const ProbedSurface whole(points, Reading::Confirmed, {});
    const ProbedSurface small(square(17, 0.8F), Reading::Confirmed, {});
    const Probes probes = whole.measure(points, small, 1, {});
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Vec3f beyond = points[i] - points[i].cwiseMin(0.8F);
        EXPECT_NEAR(probes.distances[i], beyond.norm(), 1e-4F) << points[i].transpose();
        EXPECT_GE(probes.reach[i], beyond.norm());
    }
}

}  // namespace
}  // namespace stipple
