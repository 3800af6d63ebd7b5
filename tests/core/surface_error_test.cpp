#include "stipple/surface_error.hpp"

#include "color_difference.hpp"
#include "distance_statistics.hpp"
#include "foot_finder.hpp"
#include "plane_kernels.hpp"
#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "stipple/hierarchical_clustering.hpp"
#include "stipple/neighbors.hpp"
#include "support/eigen_system.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <numbers>
#include <random>
#include <sstream>
#include <stop_token>
#include <string>

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
    const SurfaceErrorMeter meter(reference, {.samples = 3000});
    for (const float factor : {1.1F, 0.8F}) {
        const PointCloud candidate = scaled(sphere(2000), factor);
        const SurfaceError one = measure_error(reference, candidate, {.samples = 3000});
        EXPECT_EQ(meter.measure(candidate).mean(), one.mean());
        EXPECT_EQ(meter.measure(candidate).max(), one.max());
    }
}

TEST(EstimatedError, IsNearThatFromManySamples) {
    const PointCloud reference = sphere(60'000), candidate = scaled(sphere(2000), 1.02F);
    const SurfaceError many = measure_error(reference, candidate);
    const SurfaceError few = estimate_error(reference, candidate);
    EXPECT_EQ(few.forward.samples, 400U);
    EXPECT_NEAR(few.mean(), many.mean(), 0.03 * many.mean());
    EXPECT_NEAR(few.backward.mean, many.backward.mean, 0.03 * many.backward.mean);
    EXPECT_EQ(few.diagonal, many.diagonal);
}

TEST(EstimatedError, SeesThatAPartIsMissing) {
    const PointCloud whole = test::plane(20'000);
    PointCloud half;
    for (const Vec3f& p : whole.positions)
        if (p.x() < 0.5F) half.positions.push_back(p);
    const SurfaceError error = estimate_error(whole, half);
    EXPECT_GT(error.forward.max, 0.45);
    EXPECT_LT(error.backward.max, 0.01);
    // Half of the area is 0 to 0.5 away: 0.125 on the average.
    EXPECT_NEAR(error.mean(), 0.125, 0.02);
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

/// The fixed point by the letter: all points sorted by distance, everything in doubles.
struct SlowFoot {
    double distance = std::numeric_limits<double>::infinity();
    double h = 0;
    bool converged = false;
};

SlowFoot slow_foot(const std::vector<Vec3f>& points, unsigned k, const Vec3d& q, Vec3d x) {
    SlowFoot foot;
    for (int i = 0; i < 200 && !foot.converged; ++i) {
        std::vector<Vec3d> near;
        for (const Vec3f& p : points) near.push_back(p.cast<double>());
        std::ranges::partial_sort(near, near.begin() + k, {},
                                  [&](const Vec3d& p) { return (p - x).squaredNorm(); });
        near.resize(k);
        foot.h = (near.back() - x).norm() / 3;
        const auto weight = [&](const Vec3d& p) {
            return std::exp(-(p - x).squaredNorm() / (foot.h * foot.h));
        };
        double total = 0;
        Vec3d a = Vec3d::Zero();
        for (const Vec3d& p : near) {
            total += weight(p);
            a += weight(p) * p;
        }
        a /= total;
        Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
        for (const Vec3d& p : near) covariance += weight(p) * (p - a) * (p - a).transpose();
        const Vec3d n = test::eigen_system(covariance).vectors.col(0);
        const Vec3d next = q - n.dot(q - a) * n;
        foot.converged = (next - x).norm() <= 1e-4 * foot.h;
        foot.distance = (q - next).norm();
        x = next;
    }
    return foot;
}

TEST(FootFinder, FindsTheFixedPointsOfTheSlowForm) {
    const PointCloud target = random_subset(sphere(20'000, 0.02), 600);
    const PointTree tree(target.positions, PointTree::Leaves::Compact, {});
    for (const unsigned k : {6U, 20U, 40U}) {
        const FootFinder finder(target.positions, tree, {.k = k, .tolerance = 1e-5});
        const std::vector<Vec3f> queries = random_subset(sphere(5000, 0.1, 2), 300).positions;
        std::vector<Foot> feet(queries.size());
        finder.find(queries, [&](std::size_t i, const Foot& foot) { feet[i] = foot; }, {});
        int compared = 0, differ = 0;
        for (std::size_t i = 0; i < queries.size(); ++i) {
            const Vec3d q = queries[i].cast<double>();
            const auto& nearest = *std::ranges::min_element(
                target.positions, {}, [&](const Vec3f& p) { return (p - queries[i]).norm(); });
            const SlowFoot direct = slow_foot(target.positions, k, q, q);
            const SlowFoot from_sample = slow_foot(target.positions, k, q, nearest.cast<double>());
            if (!direct.converged || !from_sample.converged || !feet[i].converged) continue;
            ++compared;
            const double least = std::min(direct.distance, from_sample.distance);
            differ += std::abs(feet[i].distance - least) > 1e-3 * direct.h;
            EXPECT_TRUE(feet[i].beyond ||
                        std::abs((feet[i].point - q).norm() - feet[i].distance) < 1e-5);
        }
        EXPECT_GT(compared, 250) << k;
        EXPECT_LE(differ, compared / 100) << k;
    }
}

TEST(FootFinder, TakesTheNearerOfTwoSheets) {
    PointCloud cloud = test::plane(5000);
    const PointCloud above = shifted(test::plane(5000, 2), {0, 0, 0.06F});
    cloud.positions.insert(cloud.positions.end(), above.positions.begin(), above.positions.end());
    const PointTree tree(cloud.positions, PointTree::Leaves::Compact, {});
    std::vector<Vec3f> queries;
    for (const float z : {-0.02F, 0.0F, 0.01F, 0.05F, 0.06F, 0.08F})
        for (float x = 0.2F; x < 0.8F; x += 0.01F) queries.emplace_back(x, 0.5F, z);
    FootFinder(cloud.positions, tree, {})
        .find(queries,
              [&](std::size_t i, const Foot& foot) {
                  const double z = queries[i].z();
                  EXPECT_NEAR(foot.distance, std::min(std::abs(z), std::abs(z - 0.06)), 1e-4) << z;
              },
              {.threads = 1});
}

TEST(PlaneKernels, GiveTheSameBits) {
    const auto kernels = available_plane_kernels();
    std::mt19937_64 random(3);
    std::uniform_real_distribution<float> unit(-1, 1);
    for (int round = 0; round < 200; ++round) {
        PlaneLanes lanes(6 + static_cast<unsigned>(round % 30), 64);
        lanes.rows = 40 + static_cast<std::size_t>(round % 20);
        for (std::size_t j = 0; j < lanes.rows; ++j) {
            for (std::size_t lane = 0; lane < PlaneLanes::kLanes; ++lane) {
                // A grid in some lanes: equal distances.
                const float step = lane % 2 == 0 ? 0.0F : 0.25F;
                const auto place = [&] {
                    const float v = unit(random);
                    return step > 0 ? step * std::round(v / step) : v;
                };
                lanes.candidates[j].x[lane] = place();
                lanes.candidates[j].y[lane] = place();
                lanes.candidates[j].z[lane] = 0.1F * place();
            }
        }
        for (std::size_t lane = 0; lane < PlaneLanes::kLanes; ++lane) {
            lanes.place.x[lane] = lane == 3 ? 0.0F : unit(random);
            lanes.query.z[lane] = unit(random);
            lanes.radius_guess_sq[lane] = unit(random) + 1;
        }
        PlaneLanes plain = lanes;
        kernels.front().run(plain);
        for (const PlaneKernel& kernel : kernels) {
            PlaneLanes other = lanes;
            kernel.run(other);
            EXPECT_EQ(other.radius_sq, plain.radius_sq) << kernel.name;
            EXPECT_EQ(other.nearest_sq, plain.nearest_sq);
            EXPECT_EQ(other.height, plain.height);
            EXPECT_EQ(other.step_sq, plain.step_sq);
            EXPECT_EQ(other.normal.x, plain.normal.x);
            EXPECT_EQ(other.foot.z, plain.foot.z);
            EXPECT_EQ(other.flat, plain.flat);
        }
        for (std::size_t lane = 0; lane < PlaneLanes::kLanes; ++lane) {
            std::vector<float> distances;
            for (std::size_t j = 0; j < lanes.rows; ++j)
                distances.push_back(plain.scratch[j].sq[lane]);
            std::ranges::sort(distances);
            EXPECT_EQ(plain.radius_sq[lane], distances[lanes.k - 1]);
            EXPECT_EQ(plain.nearest_sq[lane], distances.front());
        }
    }
}

TEST(WeightedQuantiles, AreThoseOfTheSortedValues) {
    std::mt19937_64 random(9);
    std::exponential_distribution<float> value(3), weight(1);
    std::vector<float> values, weights;
    for (int i = 0; i < 5000; ++i) {
        values.push_back(i % 10 == 0 ? 0.25F : value(random));
        weights.push_back(weight(random));
    }
    std::vector<std::pair<float, float>> sorted;
    for (std::size_t i = 0; i < values.size(); ++i) sorted.emplace_back(values[i], weights[i]);
    std::ranges::sort(sorted);
    double total = 0;
    for (const float w : weights) total += w;
    const std::vector<double> parts = {0.0, 0.1, 0.5, 0.9, 0.999, 1.0};
    const auto quantiles = weighted_quantiles(values, weights, parts);
    for (std::size_t p = 0; p < parts.size(); ++p) {
        double up_to = 0;
        std::size_t at = 0;
        while (at + 1 < sorted.size() && (up_to += sorted[at].second) < parts[p] * total) ++at;
        EXPECT_NEAR(quantiles[p], sorted[at].first, 1e-3 * sorted[at].first) << parts[p];
    }
}

TEST(Ciede2000, HasTheValuesOfItsTestData) {
    // Sharma, Wu, Dalal 2005, table 1: pairs 1, 4, 7, 10, 13, 17, 20, 25, 28, 31, 34.
    struct Pair {
        Vec3d a, b;
        double difference;
    };
    const Pair pairs[] = {
        {{50, 2.6772, -79.7751}, {50, 0, -82.7485}, 2.0425},
        {{50, -1.3802, -84.2814}, {50, 0, -82.7485}, 1.0000},
        {{50, 0, 0}, {50, -1, 2}, 2.3669},
        {{50, 2.4900, -0.0010}, {50, -2.4900, 0.0010}, 7.1792},
        {{50, -0.0010, 2.4900}, {50, 0.0009, -2.4900}, 4.8045},
        {{50, 2.5, 0}, {73, 25, -18}, 27.1492},
        {{50, 2.5, 0}, {58, 24, 15}, 19.4535},
        {{60.2574, -34.0099, 36.2677}, {60.4626, -34.1751, 39.4387}, 1.2644},
        {{35.0831, -44.1164, 3.7933}, {35.0232, -40.0716, 1.5901}, 1.8645},
        {{36.4612, 47.8580, 18.3852}, {36.2715, 50.5065, 21.2231}, 1.4146},
        {{2.0776, 0.0795, -1.1350}, {0.9033, -0.0636, -0.5514}, 0.9082},
    };
    for (const Pair& pair : pairs) {
        EXPECT_NEAR(ciede2000(pair.a, pair.b), pair.difference, 1e-4);
        EXPECT_NEAR(ciede2000(pair.b, pair.a), pair.difference, 1e-4);
        EXPECT_EQ(ciede2000(pair.a, pair.a), 0);
    }
    EXPECT_NEAR(lab_from_linear({1, 1, 1}).x(), 100, 1e-9);
    EXPECT_NEAR(ciede2000(lab_from_linear({1, 1, 1}), lab_from_linear({0, 0, 0})), 100, 1e-6);
}

const AttributeError& attribute(const DirectedError& error, const std::string& name) {
    const auto found = std::ranges::find(error.attributes, name, &AttributeError::name);
    if (found == error.attributes.end()) throw std::runtime_error("no attribute " + name);
    return *found;
}

TEST(AttributeErrors, AreKnownForKnownDifferences) {
    PointCloud a = test::plane(3000), b = test::plane(1000, 2);
    const auto dress = [](PointCloud& cloud, const Rgba8& color, const Vec3f& normal, float offset,
                          std::uint8_t label) {
        cloud.colors.assign(cloud.size(), color);
        cloud.normals.assign(cloud.size(), normal);
        std::vector<float> heat;
        for (const Vec3f& p : cloud.positions) heat.push_back(p.x() + offset);
        cloud.attributes = {
            {"heat", heat, 1, Reduction::Mean},
            {"label", std::vector<std::uint8_t>(cloud.size(), label), 1, Reduction::Nearest},
            {offset > 0 ? "only_b" : "only_a", heat, 1, Reduction::Mean}};
    };
    dress(a, {255, 255, 255}, Vec3f::UnitZ(), 0, 3);
    dress(b, {0, 0, 0}, Vec3f::UnitX(), 0.5F, 7);
    const SurfaceError error = measure_error(a, b, {.samples = 2000, .attributes = true});
    for (const DirectedError& d : {error.forward, error.backward}) {
        ASSERT_EQ(d.attributes.size(), 4U);
        EXPECT_NEAR(attribute(d, "color").mean, 100, 1e-3);
        EXPECT_NEAR(attribute(d, "normal").mean, std::numbers::pi / 2, 1e-5);
        EXPECT_NEAR(attribute(d, "heat").mean, 0.5, 0.01);
        EXPECT_NEAR(attribute(d, "label").max, 4, 1e-6);
        EXPECT_NEAR(attribute(d, "label").rms, 4, 1e-6);
    }
    const SurfaceError same = measure_error(a, a, {.samples = 2000, .attributes = true});
    EXPECT_LT(attribute(same.forward, "color").max, 1e-3);
    EXPECT_LT(attribute(same.forward, "heat").mean, 0.01);
    EXPECT_TRUE(measure_error(a, b, {.samples = 100}).forward.attributes.empty());
}

/// Distance to a triangle (Ericson 2005, by the region that the projection falls into).
double distance_to_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const auto to_segment = [&](const Vec3d& s, const Vec3d& e) {
        const double t = std::clamp((p - s).dot(e - s) / (e - s).squaredNorm(), 0.0, 1.0);
        return (p - (s + t * (e - s))).norm();
    };
    const Vec3d n = (b - a).cross(c - a);
    const bool inside = n.dot((b - a).cross(p - a)) >= 0 && n.dot((c - b).cross(p - b)) >= 0 &&
                        n.dot((a - c).cross(p - c)) >= 0;
    if (inside && n.squaredNorm() > 0) return std::abs(n.dot(p - a)) / n.norm();
    return std::min({to_segment(a, b), to_segment(b, c), to_segment(c, a)});
}

TEST(SurfaceError, AgreesWithDistancesToTheTrueMesh) {
    const auto file = test::shared_file("models/bun_zipper.ply");
    if (!file) GTEST_SKIP() << "no models/bun_zipper.ply in the shared test data";
    // ascii: x y z confidence intensity, then triangles.
    std::ifstream in(*file);
    std::size_t points = 0, faces = 0;
    for (std::string line; std::getline(in, line) && line != "end_header";) {
        std::istringstream words(line);
        std::string element, kind;
        words >> element >> kind;
        if (element == "element") words >> (kind == "vertex" ? points : faces);
    }
    PointCloud cloud;
    double skipped = 0;
    for (std::size_t i = 0; i < points; ++i) {
        Vec3f p;
        in >> p.x() >> p.y() >> p.z() >> skipped >> skipped;
        cloud.positions.push_back(p);
    }
    std::vector<std::array<Index, 3>> triangles(faces);
    std::vector<std::vector<std::size_t>> around(points);
    for (std::size_t f = 0; f < faces; ++f) {
        in >> skipped;
        for (Index& corner : triangles[f]) {
            in >> corner;
            around[corner].push_back(f);
        }
    }
    ASSERT_TRUE(in);

    const PointCloud small = hierarchical_clustering(
        cloud, {.target_size = 3000, .representative = Representative::Centroid});
    const SurfaceError error = measure_error(cloud, small, {.samples = 8000, .keep_samples = true});
    const NeighborSearch search(cloud.positions);
    double sum = 0;
    for (const Vec3f& q : error.backward.positions) {
        std::array<Neighbor, 24> room;
        double least = std::numeric_limits<double>::infinity();
        for (const Neighbor& vertex : search.nearest(q, room)) {
            for (const std::size_t f : around[vertex.index]) {
                const auto corner = [&](std::size_t j) -> Vec3d {
                    return cloud.positions[triangles[f][j]].cast<double>();
                };
                least = std::min(
                    least, distance_to_triangle(q.cast<double>(), corner(0), corner(1), corner(2)));
            }
        }
        sum += least;
    }
    const double truth = sum / static_cast<double>(error.backward.positions.size());
    EXPECT_NEAR(error.backward.mean, truth, 0.1 * truth);
}

}  // namespace
}  // namespace stipple
