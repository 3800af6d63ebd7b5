#include "stipple/surface_error.hpp"

#include "stipple/error.hpp"
#include "stipple/simplify.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stop_token>
#include <string>
#include <utility>

namespace stipple {
namespace {

using test::sphere;

PointCloud scaled(PointCloud cloud, float by) {
    for (Vec3f& p : cloud.positions) p *= by;
    return cloud;
}

PointCloud shifted(PointCloud cloud, const Vec3f& by) {
    for (Vec3f& p : cloud.positions) p += by;
    return cloud;
}

PointCloud random_subset(const PointCloud& cloud, std::size_t n, std::uint64_t seed = 1) {
    std::vector<Index> indices(cloud.size());
    for (Index i = 0; i < indices.size(); ++i) indices[i] = i;
    std::ranges::shuffle(indices, std::mt19937_64(seed));
    indices.resize(n);
    return subset(cloud, indices);
}

PointCloud torus(std::size_t n, double tube, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> unit(0, 1);
    PointCloud cloud;
    while (cloud.size() < n) {
        const double around = 2 * std::numbers::pi * unit(random);
        const double tilt = 2 * std::numbers::pi * unit(random);
        if (unit(random) * (1 + tube) > 1 + tube * std::cos(tilt)) continue;  // even by area
        const double r = 1 + tube * std::cos(tilt);
        cloud.positions.push_back(
            Vec3d(r * std::cos(around), r * std::sin(around), tube * std::sin(tilt)).cast<float>());
    }
    return cloud;
}

TEST(SurfaceError, OfParallelPlanesIsTheirDistance) {
    const PointCloud a = test::plane(20'000, 1);
    const PointCloud b = shifted(test::plane(5'000, 2), {0, 0, 0.125F});
    const SurfaceError error = measure_error(a, b, {.samples = 20'000});
    EXPECT_NEAR(error.diagonal, std::sqrt(2.0), 1e-3);
    for (const DirectedError& d : {error.forward, error.backward}) {
        EXPECT_EQ(d.samples, 20'000U);
        EXPECT_EQ(d.not_converged, 0);
        for (const double distance : {d.max, d.mean, d.rms, d.p50, d.p95, d.p99})
            EXPECT_NEAR(distance, 0.125, 1e-4);
        EXPECT_LT(d.mean_confidence, 1e-5);
        EXPECT_NEAR(d.histogram.back(), 1, 1e-3);
    }
}

TEST(SurfaceError, OfConcentricSpheresIsTheDifferenceOfTheirRadii) {
    const PointCloud a = sphere(40'000), b = scaled(sphere(39'000), 1.02F);
    const SurfaceError error = measure_error(a, b, {.samples = 20'000});
    // The points lie outside the smoothed surface that they are measured to by 1.1e-4.
    EXPECT_NEAR(error.forward.mean, 0.02, 2e-4);
    EXPECT_NEAR(error.backward.mean, 0.02, 2e-4);
    EXPECT_NEAR(error.max(), 0.02, 4e-4);
}

TEST(SurfaceError, OfACoarseSphereIsTheBiasOfTheLinearBasis) {
    // k points lie within a cap of area k A / N, so r^2 = 4 k / N and h^2 kappa / 2 = 2 k / (9 N).
    const std::size_t n = 2000;
    const PointCloud fine = sphere(40'000), coarse = sphere(n);
    const double bias = 2.0 * 20 / (9.0 * n);
    const SurfaceError linear = measure_error(fine, coarse, {.samples = 5000});
    EXPECT_NEAR(linear.forward.mean, bias, 0.1 * bias);
    EXPECT_NEAR(linear.backward.mean, bias, 0.1 * bias);
    const SurfaceError quadratic =
        measure_error(fine, coarse, {.samples = 5000, .surface = ErrorSurface::Quadratic});
    EXPECT_LT(quadratic.forward.mean, 0.05 * bias);
    EXPECT_LT(quadratic.backward.mean, 0.05 * bias);
}

TEST(SurfaceError, OfTwoSpheresWithTheQuadraticBasisIsTheDifferenceEverywhere) {
    // Also in gaps, where the surface lies higher than all points around.
    const auto random_sphere = [](float radius, unsigned seed) {
        std::mt19937 random(seed);
        std::normal_distribution<float> along;
        PointCloud cloud;
        for (int i = 0; i < 20'000; ++i) {
            const Vec3f way(along(random), along(random), along(random));
            cloud.positions.push_back(radius * way.normalized());
        }
        return cloud;
    };
    for (const unsigned seed : {1U, 2U, 3U}) {
        const SurfaceError error =
            measure_error(random_sphere(1, seed), random_sphere(1.001F, seed + 10),
                          {.surface = ErrorSurface::Quadratic});
        EXPECT_NEAR(error.forward.mean, 1e-3, 1e-5) << seed;
        EXPECT_LT(error.max(), 1.05e-3) << seed;
    }
}

TEST(SurfaceError, IsTheSameFromParticlesAndFromRandomPlaces) {
    const PointCloud fine = sphere(3000), coarse = scaled(sphere(1000), 1.01F);
    SurfaceErrorOptions options = {
        .sampling = ErrorSampling::Surface, .samples = 4000, .keep_samples = true};
    const SurfaceError random = measure_error(fine, coarse, options);
    options.sampling = ErrorSampling::Particles;
    const SurfaceError particles = measure_error(fine, coarse, options);
    EXPECT_EQ(particles.forward.samples, 4000U);
    EXPECT_EQ(particles.forward.positions.size(), 4000U);
    EXPECT_NEAR(particles.forward.mean, random.forward.mean, 0.03 * random.forward.mean);
    EXPECT_NEAR(particles.backward.mean, random.backward.mean, 0.05 * random.backward.mean);
}

TEST(SurfaceError, OfToriOfDifferentTubesIsTheDifference) {
    const PointCloud a = torus(60'000, 0.4, 1), b = torus(60'000, 0.42, 2);
    const SurfaceError error = measure_error(a, b, {.samples = 20'000});
    EXPECT_NEAR(error.forward.mean, 0.02, 4e-4);
    EXPECT_NEAR(error.backward.mean, 0.02, 4e-4);
    EXPECT_LT(error.max(), 0.025);
}

TEST(SurfaceError, OfAShiftedSphereIsTheShiftAtItsPoles) {
    // | |x - t| - 1 | is about t |cos|: t at the poles, t / 2 in the mean, t / sqrt 3 in squares.
    const float t = 0.02F;
    const PointCloud a = sphere(40'000), b = shifted(a, {t, 0, 0});
    const SurfaceError error = measure_error(a, b, {.samples = 40'000});
    EXPECT_NEAR(error.max(), t, 0.02 * t);
    EXPECT_NEAR(error.mean(), t / 2, 0.02 * t);
    EXPECT_NEAR(error.rms(), t / std::sqrt(3.0), 0.02 * t);
    EXPECT_NEAR(error.forward.p50, t / 2, 0.02 * t);
    EXPECT_NEAR(error.forward.p95, 0.95 * t, 0.02 * t);
}

TEST(SurfaceError, OfARandomSubsetIsNotZero) {
    const PointCloud all = sphere(50'000), some = random_subset(all, 1000);
    const SurfaceError error = measure_error(all, some, {.samples = 20'000});
    EXPECT_GT(error.forward.mean, 1e-3);
    EXPECT_GT(error.backward.mean, 1e-3);
    const SurfaceError points = measure_error(all, some, {.surface = ErrorSurface::Samples});
    EXPECT_EQ(points.backward.max, 0);
    EXPECT_EQ(points.backward.samples, 1000U);
}

TEST(SurfaceError, OfASubsetIsTheSameFromFewSamples) {
    // At the points of the subset, which lie on the whole, there would be no distance.
    const PointCloud all = sphere(50'000), some = random_subset(all, 1000);
    const SurfaceError many = measure_error(all, some, {.samples = 20'000});
    const SurfaceError few = measure_error(all, some, {.samples = 900});
    EXPECT_NEAR(few.backward.mean, many.backward.mean, 0.1 * many.backward.mean);
}

TEST(SurfaceError, OfAMeterIsThatOfEachCandidate) {
    const PointCloud reference = sphere(5000);
    SurfaceErrorMeter meter(reference, {.samples = 3000});
    for (const float factor : {1.1F, 0.8F, 0.9F}) {
        const PointCloud candidate = scaled(sphere(2000), factor);
        const SurfaceError one = measure_error(reference, candidate, {.samples = 3000});
        EXPECT_EQ(meter.measure(candidate).mean(), one.mean());
        EXPECT_EQ(meter.measure(candidate).max(), one.max());
        const SurfaceError other =
            measure_error(reference, candidate, {.samples = 2000, .seed = 7});
        EXPECT_EQ(meter.measure(candidate, 2000, 7).mean(), other.mean());
        EXPECT_NE(other.mean(), one.mean());
    }
}

TEST(EstimatedError, IsNearThatFromManySamples) {
    const PointCloud reference = sphere(60'000), candidate = scaled(sphere(2000), 1.02F);
    const SurfaceError many = measure_error(reference, candidate);
    const SurfaceError few = estimate_error(reference, candidate);
    EXPECT_EQ(few.forward.samples, 160U);
    EXPECT_NEAR(few.mean(), many.mean(), 0.03 * many.mean());
    EXPECT_NEAR(few.backward.mean, many.backward.mean, 0.03 * many.backward.mean);
    EXPECT_EQ(few.diagonal, many.diagonal);
}

/// A bumpy sphere of which one half has a hundred times as many points on the same area.
PointCloud uneven_sphere(std::size_t n, unsigned seed) {
    PointCloud cloud;
    std::mt19937 random(seed);
    for (const Vec3f& p : sphere(n).positions)
        if (p.x() < 0 || random() % 100 == 0)
            cloud.positions.push_back((1 + 0.05F * std::sin(9 * p.x()) * std::cos(7 * p.y())) * p);
    std::ranges::shuffle(cloud.positions, random);
    return cloud;
}

TEST(EstimatedError, IsThatFromManySamplesInTheMeanWhereDensityIsUneven) {
    // By points alone a sparse half would hardly count.
    constexpr unsigned kSeeds = 8;
    for (const Method method : {Method::Voxel, Method::Random}) {
        double forward = 0, backward = 0;
        for (unsigned seed = 0; seed < kSeeds; ++seed) {
            const PointCloud reference = uneven_sphere(220'000, seed);
            const PointCloud candidate = simplify(reference, {.method = method, .points = 1'500});
            const SurfaceError many = measure_error(reference, candidate, {.samples = 20'000});
            const SurfaceError few = estimate_error(reference, candidate);
            forward += few.forward.mean / many.forward.mean / kSeeds;
            backward += few.backward.mean / many.backward.mean / kSeeds;
            EXPECT_GT(few.max(), 0.15 * many.max()) << to_string(method) << seed;
        }
        EXPECT_NEAR(forward, 1, 0.15) << to_string(method);
        EXPECT_NEAR(backward, 1, 0.15) << to_string(method);
    }
}

TEST(EstimatedError, SeesThatAPartIsMissing) {
    constexpr unsigned kPlanes = 8;
    double mean = 0, measured = 0;
    for (unsigned seed = 1; seed <= kPlanes; ++seed) {
        const PointCloud whole = test::plane(20'000, seed);
        PointCloud half;
        for (const Vec3f& p : whole.positions)
            if (p.x() < 0.5F) half.positions.push_back(p);
        const SurfaceError error = estimate_error(whole, half);
        EXPECT_GT(error.forward.max, 0.45);
        EXPECT_LT(error.backward.max, 0.01);
        const double exact = measure_error(whole, half).mean();
        EXPECT_NEAR(error.mean(), exact, 0.02);
        mean += error.mean() / kPlanes;
        measured += exact / kPlanes;
    }
    // Half of the area is 0 to 0.5 away, less what the other surface reaches beyond its points.
    EXPECT_NEAR(mean, 0.125, 0.02);
    EXPECT_NEAR(mean, measured, 0.006);
}

TEST(EstimatedError, GivesTheSameForAnyNumberOfThreads) {
    const PointCloud reference = sphere(200'000), candidate = scaled(sphere(2000), 1.02F);
    RunContext one, eight;
    one.threads = 1;
    eight.threads = 8;
    const SurfaceError a = estimate_error(reference, candidate, one);
    const SurfaceError b = estimate_error(reference, candidate, eight);
    EXPECT_EQ(a.mean(), b.mean());
    EXPECT_EQ(a.max(), b.max());
    EXPECT_EQ(a.backward.rms, b.backward.rms);
}

TEST(SurfaceError, OfACloudAndItselfIsTheSmoothingAlone) {
    const PointCloud cloud = test::plane(5000);
    EXPECT_LT(measure_error(cloud, cloud, {.samples = 5000}).max(), 1e-5);
    EXPECT_EQ(measure_error(cloud, cloud, {.samples = 100, .surface = ErrorSurface::Samples}).max(),
              0);
}

TEST(SurfaceError, SwapsItsDirectionsWithTheClouds) {
    const PointCloud a = sphere(5000), b = scaled(random_subset(sphere(20'000), 700), 1.01F);
    const SurfaceErrorOptions options = {.samples = 3000};
    const SurfaceError ab = measure_error(a, b, options), ba = measure_error(b, a, options);
    EXPECT_NEAR(ab.forward.mean, ba.backward.mean, 1e-5);
    EXPECT_NEAR(ab.forward.max, ba.backward.max, 1e-4);
    EXPECT_NEAR(ab.backward.mean, ba.forward.mean, 1e-5);
    EXPECT_NEAR(ab.backward.max, ba.forward.max, 1e-4);
    EXPECT_EQ(ab.max(), std::max(ab.forward.max, ab.backward.max));
}

TEST(SurfaceError, TellsWhereItIsLargest) {
    const Vec3d origin(5e6, 6e6, 100);
    PointCloud plane = test::plane(5'000), dented = plane;
    for (PointCloud* const cloud : {&plane, &dented}) cloud->origin = origin;
    const Vec3f middle(0.3F, 0.6F, 0);
    for (Vec3f& p : dented.positions) p.z() += 0.2F * std::exp(-100 * (p - middle).squaredNorm());
    const Vec3d there = origin + middle.cast<double>();
    for (const std::uint64_t samples : {0, 20'000}) {
        const SurfaceError error = measure_error(plane, dented, {.samples = samples});
        EXPECT_LT((error.forward.max_at.value() - there).norm(), 0.1);
        EXPECT_LT((error.backward.max_at.value() - there - Vec3d(0, 0, 0.2)).norm(), 0.1);
    }
}

TEST(SurfaceError, EndsWhereTheSamplesEnd) {
    const PointCloud whole = test::plane(20'000);
    PointCloud half;
    for (const Vec3f& p : whole.positions)
        if (p.x() < 0.5F) half.positions.push_back(p);
    const SurfaceError error = measure_error(whole, half, {.samples = 20'000});
    // The plane goes on as far as the radius of a neighbourhood.
    EXPECT_LT(error.forward.max, 0.5);
    EXPECT_GT(error.forward.max, 0.45);
    EXPECT_NEAR(error.forward.mean, 0.125, 0.025);
    EXPECT_LT(error.backward.max, 1e-4);
}

TEST(SurfaceError, TellsAHoleByTheDistanceToTheNearestPoint) {
    // Without a cap whose rim is 0.3 from its pole, which the surface bridges.
    const PointCloud whole = sphere(10'000);
    PointCloud holed;
    for (const Vec3f& p : whole.positions)
        if ((p - Vec3f::UnitZ()).norm() > 0.3F) holed.positions.push_back(p);
    for (const SurfaceError& error :
         {measure_error(whole, holed), estimate_error(whole, holed),
          measure_error(whole, holed, {.surface = ErrorSurface::Samples})}) {
        EXPECT_LT(error.forward.cover_radius.value(), 0.32);
        EXPECT_LT(error.backward.cover_radius.value(), 0.05);
    }
    EXPECT_GT(measure_error(whole, holed).forward.cover_radius.value(), 0.28);
    EXPECT_LT(measure_error(whole, whole).forward.cover_radius.value(), 0.05);
    EXPECT_EQ(measure_error(whole, holed).forward.cover_radius,
              measure_error(whole, holed, {}, {.threads = 5}).forward.cover_radius);
}

TEST(SurfaceError, HasNoSurfaceAroundAPointFarOff) {
    for (const float far : {3.0F, 25.0F, 1e6F}) {
        PointCloud cloud = sphere(3'000);
        cloud.positions[7] = {far, 0, 0};
        PointCloud candidate = sphere(1'500);
        candidate.positions[3] = {far, 0, 0};
        for (const ErrorSampling sampling :
             {ErrorSampling::Points, ErrorSampling::Surface, ErrorSampling::Particles}) {
            const SurfaceError error =
                measure_error(cloud, candidate, {.sampling = sampling, .samples = 20'000});
            EXPECT_LT(error.max(), 0.2) << far << ' ' << static_cast<int>(sampling);
            EXPECT_LT(error.mean(), 0.02) << far << ' ' << static_cast<int>(sampling);
        }
        EXPECT_LT(estimate_error(cloud, candidate).max(), 0.2) << far;
    }
}

TEST(SurfaceError, WeighsPointsByTheirArea) {
    // Ten times as many points on the left, where the distance is 0.01; 0.03 on the right.
    PointCloud reference, candidate;
    for (const Vec3f& p : test::plane(40'000).positions)
        if (p.x() < 0.5F) reference.positions.push_back(p);
    for (const Vec3f& p : test::plane(4'000, 2).positions)
        if (p.x() >= 0.5F) reference.positions.push_back(p);
    for (const Vec3f& p : test::plane(20'000, 3).positions)
        candidate.positions.emplace_back(p.x(), p.y(), p.x() < 0.5F ? 0.01F : 0.03F);
    for (const std::uint64_t samples : {2000, 22'000}) {
        const SurfaceError error = measure_error(reference, candidate, {.samples = samples});
        EXPECT_NEAR(error.forward.mean, 0.02, 0.001) << samples;
    }
    const SurfaceError error =
        measure_error(reference, candidate, {.sampling = ErrorSampling::Surface, .samples = 4000});
    EXPECT_NEAR(error.forward.mean, 0.02, 0.001);
}

TEST(SurfaceError, MeasuresAPointAndALineByTheirSamples) {
    PointCloud point;
    point.positions = {{0, 0, 1}};
    PointCloud two = point;
    two.positions.emplace_back(0, 0, 3);
    const SurfaceError apart = measure_error(point, two, {.samples = 100});
    EXPECT_EQ(apart.forward.max, 0);
    EXPECT_NEAR(apart.backward.max, 2, 1e-5);
    EXPECT_EQ(apart.diagonal, 0);

    const PointCloud line = test::line(100);
    const SurfaceError same = measure_error(line, line, {.samples = 100});
    EXPECT_EQ(same.forward.max, 0);

    PointCloud many;
    many.positions.assign(300, Vec3f(5, 5, 5));
    const SurfaceError coincident = measure_error(many, many, {.samples = 100});
    EXPECT_EQ(coincident.max(), 0);
    EXPECT_TRUE(std::isfinite(measure_error(many, line, {.samples = 100}).max()));
    EXPECT_TRUE(std::isfinite(measure_error(line, many, {.samples = 100}).max()));
}

TEST(SurfaceError, IsFiniteForFewPoints) {
    const PointCloud cloud = test::cube(25), other = sphere(500);
    for (Index n = 1; n <= cloud.size(); ++n) {
        std::vector<Index> first(n);
        for (Index i = 0; i < n; ++i) first[i] = i;
        const SurfaceError error = measure_error(other, subset(cloud, first), {.samples = 200});
        EXPECT_TRUE(std::isfinite(error.max()) && std::isfinite(error.mean())) << n;
        EXPECT_TRUE(std::isfinite(error.backward.mean_confidence));
        EXPECT_LT(error.max(), 4);
    }
}

TEST(SurfaceError, ScalesWithTheUnitAndKnowsOrigins) {
    const PointCloud a = sphere(3000), b = sphere(500);
    const double error = measure_error(a, b, {.samples = 3000}).mean();
    for (const float unit : {1e-12F, 1e-3F, 1e6F, 1e15F}) {
        const SurfaceError there =
            measure_error(scaled(a, unit), scaled(b, unit), {.samples = 3000});
        EXPECT_NEAR(there.mean() / unit, error, 1e-3 * error) << unit;
    }
    PointCloud moved = shifted(b, {-64, 0, 0});
    moved.origin = {64, 0, 0};
    EXPECT_NEAR(measure_error(a, moved, {.samples = 3000}).mean(), error, 1e-3 * error);
    PointCloud far_a = a, far_b = b;
    far_a.origin = far_b.origin = {5e6, 6e6, 100};
    EXPECT_NEAR(measure_error(far_a, far_b, {.samples = 3000}).mean(), error, 1e-3 * error);
}

TEST(SurfaceError, OfDisjointCloudsIsAboutTheirDistance) {
    const PointCloud a = sphere(2000), b = shifted(a, {1000, 0, 0});
    const SurfaceError error = measure_error(a, b, {.samples = 2000});
    EXPECT_NEAR(error.mean(), 999, 2);
    EXPECT_GT(error.mean(), error.diagonal);
}

TEST(SurfaceError, OfCloudsInOtherUnitsIsTheDistanceToTheMiddleOfTheSmaller) {
    const PointCloud metres = shifted(sphere(20'000), {2, 0, 0});
    const PointCloud small = scaled(metres, 1e-12F), large = scaled(metres, 1e12F);
    const SurfaceError to_small = measure_error(metres, small);
    EXPECT_NEAR(to_small.forward.max, 3, 0.01);
    EXPECT_NEAR(to_small.backward.max, 1, 0.01);
    const SurfaceError to_large = measure_error(metres, large);
    EXPECT_NEAR(to_large.backward.max, 3e12, 1e10);
    EXPECT_NEAR(to_large.forward.max, 1e12, 1e10);
    EXPECT_EQ(to_large.forward.mean, to_large.forward.max);
    const SurfaceError beside = measure_error(metres, shifted(metres, {1'000, 0, 0}));
    EXPECT_NEAR(beside.forward.mean, 1'000, 1);
    EXPECT_NEAR(beside.backward.max, 999, 1.5);
}

TEST(SurfaceError, OfCloudsAFewSizesApartIsMeasuredFromPlaceToPlace) {
    const SurfaceError error =
        measure_error(sphere(5'000), shifted(sphere(2'000), {20, 0, 0}), {.samples = 4'000});
    EXPECT_EQ(error.forward.samples, 4'000U);
    EXPECT_EQ(error.backward.samples, 4'000U);
    EXPECT_NEAR(error.forward.max, 20, 0.1);
}

TEST(SurfaceError, KeepsItsSamplesWhenAsked) {
    PointCloud a = sphere(3000);
    a.origin = {100, 200, 300};
    PointCloud b = scaled(sphere(1000), 1.1F);
    b.origin = a.origin;
    const SurfaceError error = measure_error(a, b, {.samples = 2000, .keep_samples = true});
    ASSERT_EQ(error.forward.positions.size(), 2000U);
    ASSERT_EQ(error.forward.distances.size(), 2000U);
    EXPECT_EQ(*std::ranges::max_element(error.forward.distances),
              static_cast<float>(error.forward.max));
    for (const Vec3f& p : error.forward.positions) EXPECT_NEAR(p.norm(), 1, 1e-4);
    for (const Vec3f& p : error.backward.positions) EXPECT_NEAR(p.norm(), 1.1, 0.02);
    EXPECT_TRUE(measure_error(a, b, {.samples = 2000}).forward.positions.empty());
}

TEST(SurfaceError, SaysHowFarItsMeanMayBeOff) {
    const PointCloud a = sphere(5000), b = shifted(sphere(3000), {0.05F, 0, 0});
    const double truth = measure_error(a, b, {.samples = 50'000}).forward.mean;
    int within = 0;
    constexpr int kSeeds = 60;
    for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
        const SurfaceError error =
            measure_error(a, b, {.sampling = ErrorSampling::Surface, .samples = 300, .seed = seed});
        within += std::abs(error.forward.mean - truth) <= error.forward.mean_confidence;
        EXPECT_LT(error.forward.mean_confidence, 0.1 * truth);
    }
    EXPECT_GE(within, kSeeds * 85 / 100);
}

TEST(SurfaceError, GivesTheSameForAnyNumberOfThreads) {
    const PointCloud a = sphere(30'000, 0.01), b = random_subset(a, 2000);
    for (const ErrorSurface surface : {ErrorSurface::Linear, ErrorSurface::Quadratic}) {
        const SurfaceErrorOptions options = {
            .samples = 4000, .surface = surface, .keep_samples = true};
        const SurfaceError one = measure_error(a, b, options, {.threads = 1});
        const SurfaceError eight = measure_error(a, b, options, {.threads = 8});
        EXPECT_EQ(one.forward.distances, eight.forward.distances);
        EXPECT_EQ(one.backward.distances, eight.backward.distances);
        EXPECT_EQ(one.forward.mean, eight.forward.mean);
    }
}

TEST(SurfaceError, StopsWhenAsked) {
    const PointCloud a = sphere(2000);
    std::stop_source source;
    source.request_stop();
    EXPECT_THROW(measure_error(a, a, {}, {.stop = source.get_token()}), Cancelled);
}

TEST(SurfaceError, RefusesACandidateWhoseDistancesNoFloatTells) {
    for (const std::size_t points : {20U, 300U}) {  // measured each in their way
        const PointCloud cloud = sphere(points), tiny = scaled(sphere(20), 1e-10F);
        const PointCloud far = shifted(sphere(points), {1e30F, 0, 0});
        PointCloud farther = cloud;
        farther.origin.x() = 1e39;
        for (const auto& [reference, candidate] :
             {std::pair(&cloud, &far), {&cloud, &farther}, {&tiny, &far}}) {
            const auto refused = [](auto measure) {
                test::expect_error(ErrorCode::MalformedInput, "in the same unit and place",
                                   measure);
            };
            refused([&] { measure_error(*reference, *candidate); });
            refused([&] { measure_error(*reference, *candidate, {.attributes = true}); });
            refused([&] { estimate_error(*reference, *candidate); });
        }
    }
}

TEST(SurfaceError, RefusesWhatCannotBeCompared) {
    const PointCloud cloud = sphere(100);
    const auto message = [](const PointCloud& a, const PointCloud& b,
                            const SurfaceErrorOptions& options) -> std::string {
        try {
            measure_error(a, b, options);
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ErrorCode::InvalidArgument);
            return error.what();
        }
        return "";
    };
    PointCloud bad = cloud;
    bad.positions[7].y() = std::numeric_limits<float>::quiet_NaN();
    EXPECT_EQ(message({}, cloud, {}), "reference 0 points: expected at least 1");
    EXPECT_EQ(message(cloud, {}, {}), "candidate 0 points: expected at least 1");
    EXPECT_EQ(message(cloud, bad, {}), "candidate point 7: expected finite coordinates");
    EXPECT_EQ(message(cloud, cloud, {.k = 5}), "k 5: expected 6..64");
    EXPECT_EQ(message(cloud, cloud, {.k = 65}), "k 65: expected 6..64");
    EXPECT_EQ(message(cloud, cloud, {.max_iterations = 0}),
              "max_iterations 0: expected at least 1");
    EXPECT_NE(message(cloud, cloud, {.tolerance = 0}), "");
    EXPECT_NE(message(cloud, cloud, {.histogram_bins = 0}), "");
    EXPECT_NE(message(cloud, cloud, {.samples = std::uint64_t{1} << 40U}), "");
    EXPECT_EQ(message(cloud, cloud, {.samples = 100}), "");
}

TEST(SurfaceError, SaysWhatItsSamplesAre) {
    const auto sampling = [](ErrorSampling asked, std::uint64_t samples, std::size_t points) {
        return sampling_of({.sampling = asked, .samples = samples}, points, 500);
    };
    using enum ErrorSampling;
    EXPECT_EQ(sampling(Points, 0, 40'000), Points);
    EXPECT_EQ(sampling(Points, 0, 39'999), Surface);
    EXPECT_EQ(sampling(Points, 2'000, 2'000), Points);
    EXPECT_EQ(sampling(Points, 2'001, 2'000), Surface);
    EXPECT_EQ(sampling(Particles, 0, 40'000), Particles);
    EXPECT_EQ(sampling_of({.surface = ErrorSurface::Samples}, 10, 10), Points);
}

}  // namespace
}  // namespace stipple
