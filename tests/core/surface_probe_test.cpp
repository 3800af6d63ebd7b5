#include "error/surface_probe.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <vector>

namespace stipple {
namespace {

TEST(ProbedSurface, HasNoPlacesBeyondItsBorder) {
    constexpr int kSide = 16;
    constexpr float kSpacing = 1.0F / kSide;
    std::vector<Vec3f> points;
    for (int x = 0; x <= kSide; ++x)
        for (int y = 0; y <= kSide; ++y)
            points.emplace_back(kSpacing * static_cast<float>(x), kSpacing * static_cast<float>(y),
                                0.0F);
    for (const Reading reading : {Reading::Confirmed, Reading::ByTheLetter}) {
        const ProbedSurface surface(points, reading, {});
        const PlacesAround around = surface.places_around(points, 1.2F, 40, 0, {});
        EXPECT_GT(around.places.size(), 20 * points.size());
        float beyond = 0;
        for (const Vec3f& place : around.places)
            for (const float x : {place.x(), place.y()}) beyond = std::max({beyond, -x, x - 1});
        // As places are drawn around points on the border: 0.6 times as far as the third neighbour
        // is, beside a corner times the square root of 2.
        EXPECT_GT(beyond, 0.3F * kSpacing);
        EXPECT_LT(beyond, 0.86F * kSpacing);
    }
}

}  // namespace
}  // namespace stipple
