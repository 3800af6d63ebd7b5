#include "error/error_watch.hpp"

#include "stipple/hierarchical_clustering.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <vector>

namespace stipple {
namespace {

using test::sphere;

std::vector<Vec3f> simplified_sphere(std::size_t points) {
    return hierarchical_clustering(sphere(2'000), {.target_size = points}).positions;
}

TEST(ErrorWatch, KnowsAfterAChangeWhatItWouldFindAnew) {
    const ProbedSurface surface(sphere(2'000).positions, Reading::Confirmed, {});
    const std::vector<Vec3f> places = surface.some_points(UINT64_MAX, {});
    std::vector<Vec3f> before = simplified_sphere(300), after = before;
    for (Vec3f& p : after)
        if (p.z() > 0.8F) p *= 1.05F;
    ErrorWatch watch(surface, places, {}, 0.02, Reading::Confirmed),
        anew(surface, places, {}, 0.02, Reading::Confirmed);
    watch.look_at(before, {});
    EXPECT_LT(watch.max(), 0.04);
    watch.look_at(after, {});
    anew.look_at(after, {});
    EXPECT_GT(anew.max(), 0.04);
    EXPECT_NEAR(watch.max(), anew.max(), 1e-4);
    const double count = static_cast<double>(anew.places_too_far().size());
    EXPECT_NEAR(static_cast<double>(watch.places_too_far().size()), count, 0.02 * count);
    watch.look_at(before, {});
    EXPECT_LT(watch.max(), 0.04);
}

TEST(ErrorWatch, LooksCloserOnceNothingIsTooFar) {
    const ProbedSurface surface(sphere(2'000).positions, Reading::Confirmed, {});
    const std::vector<Vec3f> places = surface.some_points(UINT64_MAX, {});
    const std::vector<Vec3f> points = simplified_sphere(60);
    ErrorWatch first(surface, places, {}, 0.02, Reading::Confirmed);
    first.look_at(points, {});
    const double margin = 1.01 * first.max();  // all is within it, if only just
    EXPECT_FALSE(first.places_too_far().empty());
    ErrorWatch just(surface, places, {}, margin, Reading::Confirmed);
    just.look_at(points, {});
    EXPECT_GT(just.max(), first.max());
}

TEST(ErrorWatch, FindsFartherPlacesWhereTheSurfaceIsUnevenWhenItLooksAgain) {
    // Few points of a thin limb have neighbours all around it: no surface goes through them.
    PointCloud limb = sphere(3'000);
    for (Vec3f& p : limb.positions) p = {0.06F * p.x(), 0.06F * p.y(), p.z()};
    const std::vector<Vec3f> few = hierarchical_clustering(limb, {.target_size = 100}).positions;
    const ProbedSurface surface(limb.positions, Reading::Confirmed, {});
    ErrorWatch watch(surface, limb.positions, {}, 1, Reading::Confirmed);
    watch.look_at(few, {});
    const double before = watch.max();
    watch.look_again(100'000, 0, {});
    EXPECT_GT(watch.max(), before);
    EXPECT_TRUE(watch.places_too_far().empty());
}

TEST(ErrorWatch, FindsNothingBetweenASurfaceAndItself) {
    const std::vector<Vec3f> points = sphere(500).positions;
    const ProbedSurface surface(points, Reading::Confirmed, {});
    ErrorWatch watch(surface, {}, {}, 0.01, Reading::Confirmed);
    watch.look_at(points, {});
    EXPECT_LT(watch.max(), 1e-4);
    EXPECT_TRUE(watch.places_too_far().empty());
}

TEST(ErrorWatch, SeesAPointThatNoSurfaceGoesThrough) {
    const ProbedSurface surface(sphere(2'000).positions, Reading::Confirmed, {});
    std::vector<Vec3f> points = simplified_sphere(500);
    points.emplace_back(0.1F, 0.2F, 0.3F);
    ErrorWatch watch(surface, {}, {}, 0.02, Reading::Confirmed);
    watch.look_at(points, {});
    EXPECT_GT(watch.max(), 0.5);
}

}  // namespace
}  // namespace stipple
