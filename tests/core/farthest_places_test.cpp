#include "error/farthest_places.hpp"

#include "error/error_samples.hpp"
#include "stipple/surface_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <random>

namespace stipple {
namespace {

using test::sphere;

/// A sphere whose radius rises to 1.05 within a small cap, with some noise.
PointCloud with_bump(std::size_t n, double noise) {
    PointCloud cloud = sphere(n);
    std::mt19937 random(3);
    std::normal_distribution<double> normal(0.0, noise);
    const Vec3f top = Vec3f(1, 2, 3).normalized();
    for (Vec3f& p : cloud.positions) {
        const double across = (p.normalized() - top).norm() / 0.1;
        const double radius =
            1 + 0.05 * std::exp(-across * across) + (noise > 0 ? normal(random) : 0.0);
        p *= static_cast<float>(radius);
    }
    return cloud;
}

/// Points and their surface.
struct Scene {
    PointCloud cloud;
    PointTree tree;
    FootFinder finder;
    LonePoints lone_points;

    explicit Scene(PointCloud cloud_)
        : cloud(std::move(cloud_)),
          tree(cloud.positions, PointTree::Leaves::Compact, {}),
          finder(cloud.positions, tree, {}),
          lone_points(cloud.positions, tree) {}
};

std::vector<double> distances_from(std::span<const Vec3f> places, const FootFinder& surface) {
    std::vector<double> distances(places.size());
    surface.find(places, [&](std::size_t i, const Foot& foot) { distances[i] = foot.distance; },
                 {});
    return distances;
}

/// `count` of the points, measured, and the farthest of all added.
MeasuredPlaces search(const Scene& fine, const Scene& coarse, std::uint64_t count) {
    const ErrorSamples samples = take_points_by_area(fine.lone_points, count, 0, {});
    MeasuredPlaces measured{samples.positions, std::vector<double>(count)};
    std::vector<KnownDistance> known(count);
    coarse.finder.find(samples.positions,
                       [&](std::size_t i, const Foot& foot) {
                           measured.distances[i] = foot.distance;
                           known[i] = known_of(samples.numbers[i], foot, foot.distance);
                       },
                       {});
    add_farthest_points(fine.lone_points, coarse.finder, known, measured, {});
    return measured;
}

TEST(FarthestPoints, HoldTheFarthestOfAllWithFewMeasured) {
    for (const double noise : {0.0, 0.002}) {
        const Scene fine(with_bump(60'000, noise)), coarse(sphere(1'000));
        const std::vector<double> all = distances_from(fine.cloud.positions, coarse.finder);
        const MeasuredPlaces found = search(fine, coarse, 3'000);
        EXPECT_NEAR(std::ranges::max(found.distances), std::ranges::max(all), 1e-5) << noise;
        EXPECT_LT(found.places.size(), 12'000U) << noise;
        EXPECT_EQ(found.places.size(), found.distances.size());
    }
}

TEST(FarthestPoints, HoldAPointThatIsFarAwayAlone) {
    PointCloud cloud = sphere(30'000);
    cloud.positions[12'345] *= 1.2F;
    const Scene fine(cloud), coarse(sphere(1'000));
    const MeasuredPlaces found = search(fine, coarse, 500);
    const Vec3f farthest = found.places[static_cast<std::size_t>(
        std::ranges::max_element(found.distances) - found.distances.begin())];
    EXPECT_EQ(farthest, cloud.positions[12'345]);
    EXPECT_NEAR(std::ranges::max(found.distances), 0.2, 0.02);
}

TEST(FarthestPoints, AreNotPrunedByFeetThatAreNone) {
    const auto known = [](const Foot& foot) { return known_of(7, foot, foot.distance); };
    EXPECT_TRUE(std::isinf(known({.distance = 1, .converged = false}).distance));
    EXPECT_TRUE(std::isinf(known({.distance = 1, .emptiness = 0.7, .converged = true}).distance));
    EXPECT_EQ(known({.distance = 1, .emptiness = 0.4, .converged = true}).distance, 1);
    EXPECT_EQ(known({.distance = 2, .beyond = true}).distance, 2);
    EXPECT_EQ(known({.distance = 2, .beyond = true}).at, 7U);
    EXPECT_TRUE(std::isinf(known_of(7, {.distance = 2, .beyond = true}, 1).distance));
}

TEST(PlacesAroundFarthest, FindWhatManyMoreRandomPlacesFind) {
    const Scene bumpy(with_bump(3'000, 0)), round(sphere(40'000));
    const auto farthest = [&](const std::vector<Vec3f>& places) {
        return std::ranges::max(distances_from(places, round.finder));
    };
    const double all =
        farthest(take_surface(bumpy.lone_points, bumpy.finder, 100'000, 100, {}).positions);
    double least = all;
    for (std::uint64_t seed = 0; seed < 8; ++seed) {
        MeasuredPlaces few{take_surface(bumpy.lone_points, bumpy.finder, 1'000, seed, {}).positions,
                           {}};
        few.distances = distances_from(few.places, round.finder);
        least = std::min(least, std::ranges::max(few.distances));
        add_places_around_farthest(bumpy.finder, bumpy.lone_points, round.finder, few, {});
        EXPECT_NEAR(std::ranges::max(few.distances), all, 0.03 * all) << seed;
    }
    EXPECT_LT(least, 0.5 * all);  // by the places alone
}

TEST(SurfaceError, IsTheMaximumOfAllPointsAndTheMeanOfSome) {
    const PointCloud fine = with_bump(120'000, 0.001), coarse = sphere(2'000);
    const SurfaceError some = measure_error(fine, coarse);
    const SurfaceError all = measure_error(fine, coarse, {.keep_samples = true});
    EXPECT_EQ(some.forward.samples, 40'000U);
    EXPECT_EQ(all.forward.samples, 120'000U);
    EXPECT_NEAR(some.forward.max, all.forward.max, 1e-5);
    EXPECT_NEAR(some.forward.mean, all.forward.mean,
                some.forward.mean_confidence + all.forward.mean_confidence);
    EXPECT_NEAR(some.forward.rms, all.forward.rms, 0.03 * all.forward.rms);
    EXPECT_NEAR(some.forward.p99, all.forward.p99, 0.05 * all.forward.p99);
    // The share of the area at the very top of the histogram is not that of the points added.
    EXPECT_NEAR(some.forward.histogram.front(), all.forward.histogram.front(), 0.02);
}

}  // namespace
}  // namespace stipple
