#include "stipple/particle_simulation.hpp"

#include "base/random.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "stipple/neighbors.hpp"
#include "support/expect_error.hpp"
#include "support/square_grid.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <ranges>
#include <set>
#include <string_view>

namespace stipple {
namespace {

/// Of the distances to the nearest other point.
struct Spacing {
    double mean = 0, variation = 0, smallest = 0;  ///< the latter two over the mean
};

Spacing spacing_of(const std::vector<Vec3f>& points) {
    const NeighborLists lists = k_nearest_neighbors(points, 1);
    Spacing s{0, 0, std::numeric_limits<double>::infinity()};
    double square = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const double d = std::sqrt(static_cast<double>(lists.distances_sq[lists.offsets[i]]));
        s.mean += d / static_cast<double>(points.size());
        square += d * d / static_cast<double>(points.size());
        s.smallest = std::min(s.smallest, d);
    }
    s.variation = std::sqrt(std::max(0.0, square - s.mean * s.mean)) / s.mean;
    s.smallest /= s.mean;
    return s;
}

/// Points of the unit sphere, ten times as dense in one half (z > 0) as in the other.
PointCloud lopsided_sphere(std::size_t n) {
    PointCloud cloud;
    std::size_t skipped = 0;
    for (const Vec3f& p : test::sphere(n).positions)
        if (p.z() > 0 || ++skipped % 10 == 0) cloud.positions.push_back(p);
    return cloud;
}

/// A torus around z: radii 1 and 0.4.
PointCloud torus(std::size_t n) {
    PointCloud cloud;
    for (const Vec3f& p : test::plane(n, 3).positions) {
        const float u = 2 * std::numbers::pi_v<float> * p.x();
        const float v = 2 * std::numbers::pi_v<float> * p.y();
        const float ring = 1.0F + 0.4F * std::cos(v);
        cloud.positions.emplace_back(ring * std::cos(u), ring * std::sin(u), 0.4F * std::sin(v));
    }
    return cloud;
}

double distance_to_torus(const Vec3f& p) {
    const double ring = std::hypot(p.x(), p.y()) - 1.0;
    return std::abs(std::hypot(ring, static_cast<double>(p.z())) - 0.4);
}

/// The surface of the unit cube.
PointCloud box_surface(std::size_t n) {
    PointCloud cloud;
    std::size_t i = 0;
    for (const Vec3f& p : test::plane(n, 5).positions) {
        const float side = i % 2 == 0 ? 0.0F : 1.0F;
        Vec3f q;
        q[static_cast<int>(i / 2 % 3)] = side;
        q[static_cast<int>((i / 2 + 1) % 3)] = p.x();
        q[static_cast<int>((i / 2 + 2) % 3)] = p.y();
        cloud.positions.push_back(q);
        ++i;
    }
    return cloud;
}

std::size_t count_within(const std::vector<Vec3f>& points, const auto& where) {
    return static_cast<std::size_t>(std::ranges::count_if(points, where));
}

TEST(ParticleSimulation, SpreadsEvenlyHoweverUnevenlyThePointsLie) {
    // Nine of ten points in a hundredth of the area.
    constexpr std::size_t kPoints = 50'000;
    constexpr float kDense = 0.1F;
    PointCloud cloud;
    for (std::size_t i = 0; i < kPoints; ++i) {
        const float side = i % 10 == 0 ? 1.0F : kDense;
        const auto x = static_cast<float>(random_unit(1, 2 * i)) * side,
                   y = static_cast<float>(random_unit(1, 2 * i + 1)) * side;
        cloud.positions.push_back({x, y, 0.05F * std::sin(6 * x) * std::cos(6 * y)});
    }
    for (const double part : {0.05, 0.1, 0.2}) {
        const double count = part * static_cast<double>(kPoints);
        const auto result =
            particle_simulation(cloud, {.target_size = static_cast<std::uint64_t>(count)});
        const auto dense = std::ranges::count_if(
            result.positions, [](const Vec3f& p) { return p.x() < kDense && p.y() < kDense; });
        EXPECT_NEAR(static_cast<double>(dense), kDense * kDense * count,
                    0.4 * kDense * kDense * count)
            << count;
        std::set<std::array<float, 3>> places;
        for (const Vec3f& p : result.positions) places.insert({p.x(), p.y(), p.z()});
        EXPECT_EQ(places.size(), result.size()) << count;
    }
}

TEST(ParticleSimulation, LeavesNoSparsePartEmptyWhereParticlesAreFew) {
    // Half of a sphere has a thousandth of its points.
    const PointCloud even = test::sphere(60'000);
    PointCloud cloud;
    std::vector<Vec3f> sparse;
    for (std::size_t i = 0; i < even.size(); ++i) {
        const Vec3f& p = even.positions[i];
        if (p.z() < 0 && i % 500 != 0) continue;
        cloud.positions.push_back(p);
        if (p.z() < 0) sparse.push_back(p);
    }
    for (const std::uint64_t count : {150U, 600U}) {
        const auto result = particle_simulation(cloud, {.target_size = count});
        const auto below =
            std::ranges::count_if(result.positions, [](const Vec3f& p) { return p.z() < 0; });
        EXPECT_GT(static_cast<double>(below), 0.2 * static_cast<double>(count)) << count;
        for (const Vec3f& p : sparse) {
            const auto far =
                std::ranges::min(result.positions | std::views::transform([&](const Vec3f& q) {
                                     return (p - q).norm();
                                 }));
            EXPECT_LT(far, 0.4F) << count;
        }
    }
}

TEST(ParticleSimulation, KeepsToTheSurfaceBesideAPointFarOff) {
    for (const float far : {1e5F, 1e7F, 1e12F}) {
        PointCloud cloud = test::sphere(6'000);
        cloud.positions.push_back({far, 0, 0});
        const auto result = particle_simulation(cloud, {.target_size = 600});
        std::size_t near = 0;
        for (const Vec3f& p : result.positions) {
            if (p.norm() > 2) continue;
            ++near;
            EXPECT_NEAR(p.norm(), 1, 0.002) << far;
        }
        EXPECT_GT(near, 590U) << far;
    }
}

TEST(ParticleSimulation, SpacesParticlesOnASphereAsEvenlyAsPoissonDisks) {
    for (const PointCloud& cloud : {test::sphere(20'000), lopsided_sphere(20'000)}) {
        for (const std::uint64_t seed : {0U, 1U, 2U}) {
            const auto result = particle_simulation(cloud, {.target_size = 800, .seed = seed});
            const Spacing spacing = spacing_of(result.positions);
            EXPECT_LT(spacing.variation, 0.06);
            EXPECT_GT(spacing.smallest, 0.85);
            // A hexagonal lattice of as many on as large a plane: nothing can be wider spaced.
            const double widest = std::sqrt(2 / std::numbers::sqrt3 * 4 * std::numbers::pi / 800);
            EXPECT_GT(spacing.mean, 0.85 * widest);
            EXPECT_LT(spacing.mean, widest);
        }
    }
}

TEST(ParticleSimulation, SpreadsUniformlyOverAnUnevenInput) {
    const auto result = particle_simulation(lopsided_sphere(40'000), {.target_size = 1000});
    const auto upper = count_within(result.positions, [](const Vec3f& p) { return p.z() > 0; });
    EXPECT_NEAR(static_cast<double>(upper), 500.0, 25.0);
}

TEST(ParticleSimulation, KeepsParticlesWithinTheBordersOfAnOpenSurface) {
    const auto result = particle_simulation(test::square_grid(150), {.target_size = 400});
    for (const Vec3f& p : result.positions) {
        for (int axis = 0; axis < 2; ++axis) {
            EXPECT_GT(p[axis], -0.01F);
            EXPECT_LT(p[axis], 1.01F);
        }
        EXPECT_NEAR(p.z(), 0.0F, 1e-6F);
    }
    const Spacing spacing = spacing_of(result.positions);
    EXPECT_LT(spacing.variation, 0.06);
    EXPECT_GT(spacing.smallest, 0.85);
}

TEST(ParticleSimulation, LeavesHolesOpen) {
    PointCloud cloud;
    for (const Vec3f& p : test::square_grid(150).positions)
        if ((p - Vec3f(0.5F, 0.5F, 0)).norm() > 0.2F) cloud.positions.push_back(p);
    for (const Vec3f& p : particle_simulation(cloud, {.target_size = 400}).positions)
        EXPECT_GT((p - Vec3f(0.5F, 0.5F, 0)).norm(), 0.185F);
}

TEST(ParticleSimulation, PutsParticlesOnTheSurface) {
    for (const Vec3f& p : particle_simulation(test::sphere(20'000), {.target_size = 500}).positions)
        EXPECT_NEAR(p.norm(), 1.0F, 2e-5F);  // tangent planes alone are off by 3e-4
    double mean = 0;
    const auto result = particle_simulation(torus(30'000), {.target_size = 1000});
    for (const Vec3f& p : result.positions) mean += distance_to_torus(p) / 1000;
    EXPECT_LT(mean, 2e-5);
}

TEST(ParticleSimulation, UpsamplingStaysOnTheSurfaceAndIsEven) {
    const PointCloud cloud = test::sphere(1500);
    const auto result = particle_simulation(cloud, {.target_size = 6000});
    ASSERT_EQ(result.size(), 6000U);
    for (const Vec3f& p : result.positions) EXPECT_NEAR(p.norm(), 1.0F, 5e-4F);
    const Spacing spacing = spacing_of(result.positions);
    EXPECT_LT(spacing.variation, 0.06);
    EXPECT_GT(spacing.smallest, 0.85);
}

TEST(ParticleSimulation, UpsamplingInTwoStagesIsEven) {
    const auto result = particle_simulation(test::sphere(2000), {.target_size = 30'000});
    ASSERT_EQ(result.size(), 30'000U);
    const Spacing spacing = spacing_of(result.positions);
    EXPECT_LT(spacing.variation, 0.06);
    EXPECT_GT(spacing.smallest, 0.8);
}

TEST(ParticleSimulation, UpsamplingFortyfoldIsEvenOnTheSurface) {
    const auto result = particle_simulation(test::sphere(500), {.target_size = 20'000});
    ASSERT_EQ(result.size(), 20'000U);
    for (const Vec3f& p : result.positions) ASSERT_NEAR(p.norm(), 1.0F, 5e-3F);
    const Spacing spacing = spacing_of(result.positions);
    EXPECT_LT(spacing.variation, 0.05);
    EXPECT_GT(spacing.smallest, 0.7);
}

TEST(ParticleSimulation, UpsamplesWhatIsNoSurface) {
    for (const PointCloud& cloud : {test::cube(1000), test::line(1000)}) {
        const Aabb box = bounds(cloud);
        const auto result = particle_simulation(cloud, {.target_size = 9000});
        ASSERT_EQ(result.size(), 9000U);
        for (const Vec3f& p : result.positions) {
            for (int axis = 0; axis < 3; ++axis) {
                EXPECT_GE(p[axis], box.min[axis] - 0.02);
                EXPECT_LE(p[axis], box.max[axis] + 0.02);
            }
        }
    }
}

TEST(ParticleSimulation, UpsamplingInterpolatesAttributes) {
    const PointCloud cloud = test::with_attributes(test::sphere(1500));
    const auto result = particle_simulation(cloud, {.target_size = 5000});
    const auto& height = std::get<std::vector<float>>(result.attributes[0].values);
    const auto& label = std::get<std::vector<std::int32_t>>(result.attributes[1].values);
    ASSERT_EQ(height.size(), 5000U);
    for (std::size_t i = 0; i < result.size(); ++i) {
        EXPECT_NEAR(height[i], result.positions[i].z(), 0.06F);  // points are 0.1 apart
        EXPECT_TRUE(label[i] == 7 || label[i] == 1'000'003);
        EXPECT_GT(result.normals[i].dot(result.positions[i]), 0.99F);
    }
}

TEST(ParticleSimulation, RegionsHaveTheDensityAskedFor) {
    const PointCloud cloud = test::plane(25'000);
    const DensityRegion::Sphere disc{.center = {0.5, 0.5, 0}, .radius = 0.2};
    const DensityRegion::Box square{.min = {0.3, 0.3, -1}, .max = {0.7, 0.7, 1}};
    const auto density = [](const std::vector<Vec3f>& points, const auto& where, double area) {
        return static_cast<double>(count_within(points, where)) / area;
    };
    const auto outside = [](const Vec3f& p) {
        return p.x() < 0.15F || p.x() > 0.85F || p.y() < 0.15F || p.y() > 0.85F;
    };
    for (const bool round : {true, false}) {
        ParticleSimulationOptions options{.target_size = 3000};
        options.regions.push_back({.where = disc, .density = 9, .transition = 0.1});
        if (!round) options.regions.front().where = square;
        const auto points = particle_simulation(cloud, options).positions;
        const double inside = density(
            points, [&](const Vec3f& p) { return (p - Vec3f(0.5F, 0.5F, 0)).norm() < 0.18F; },
            std::numbers::pi * 0.18 * 0.18);
        EXPECT_NEAR(inside / density(points, outside, 0.51), 9.0, 1.5);
    }
}

TEST(ParticleSimulation, ARegionsDensityFallsSmoothlyInItsTransition) {
    const PointCloud cloud = test::plane(25'000);
    ParticleSimulationOptions options{.target_size = 4000};
    options.regions.push_back(
        {.where = DensityRegion::Sphere{{0.5, 0.5, 0}, 0.15}, .density = 16, .transition = 0.25});
    const auto points = particle_simulation(cloud, options).positions;
    std::vector<double> rings;  // density of rings across the transition
    for (float inner = 0.10F; inner < 0.39F; inner += 0.05F) {
        const float outer = inner + 0.05F;
        const auto inside = count_within(points, [&](const Vec3f& p) {
            const float r = (p - Vec3f(0.5F, 0.5F, 0)).norm();
            return r >= inner && r < outer;
        });
        rings.push_back(static_cast<double>(inside) /
                        (std::numbers::pi * static_cast<double>(outer * outer - inner * inner)));
    }
    for (std::size_t i = 1; i < rings.size(); ++i) {
        EXPECT_LT(rings[i], 1.05 * rings[i - 1]) << "ring " << i;
        EXPECT_GT(rings[i], 0.35 * rings[i - 1]) << "ring " << i;  // no step
    }
    EXPECT_GT(rings.front(), 8 * rings.back());
    EXPECT_GT(spacing_of(points).smallest, 0.3);  // of the mean over both densities
}

TEST(ParticleSimulation, ARegionMayBeGivenByAnAttribute) {
    const PointCloud cloud = test::with_attributes(test::sphere(40'000));
    ParticleSimulationOptions options{.target_size = 2000};
    options.regions.push_back(
        {.where = DensityRegion::Scalar{"height", 0.5, 1.0}, .density = 4, .transition = 0.2});
    const auto points = particle_simulation(cloud, options).positions;
    // Zones of a sphere have areas as their heights.
    const auto top = count_within(points, [](const Vec3f& p) { return p.z() > 0.5F; });
    const auto bottom = count_within(points, [](const Vec3f& p) { return p.z() < 0.0F; });
    EXPECT_NEAR(static_cast<double>(top) / 0.5, 4 * static_cast<double>(bottom),
                0.6 * static_cast<double>(bottom));
}

TEST(ParticleSimulation, AdaptivePutsMoreParticlesAlongEdges) {
    const PointCloud cloud = box_surface(20'000);
    const auto near_an_edge = [](const Vec3f& p) {
        std::array<float, 3> to_side = {std::min(p.x(), 1 - p.x()), std::min(p.y(), 1 - p.y()),
                                        std::min(p.z(), 1 - p.z())};
        std::ranges::sort(to_side);
        return to_side[1] < 0.06F;
    };
    const auto share = [&](double adaptivity) {
        const auto result = particle_simulation(
            cloud, {.target_size = 1000, .adaptivity = adaptivity, .max_grading = 16});
        return static_cast<double>(count_within(result.positions, near_an_edge)) / 1000;
    };
    const double uniform = share(0), half = share(0.5), full = share(1);
    EXPECT_LT(uniform, 0.25);  // their part of the area is 0.23
    EXPECT_GT(half, 1.5 * uniform);
    EXPECT_GT(full, 2 * uniform);
}

TEST(ParticleSimulation, AdaptiveSpacingIsWithinTheGrading) {
    const PointCloud cloud = box_surface(20'000);
    const auto points =
        particle_simulation(cloud, {.target_size = 800, .adaptivity = 1, .max_grading = 3})
            .positions;
    const NeighborLists lists = k_nearest_neighbors(points, 1);
    const auto [least, most] = std::ranges::minmax(lists.distances_sq);
    EXPECT_LT(std::sqrt(most / least), 3 * 1.5);
}

TEST(ParticleSimulation, AdaptiveOnAPlaneIsUniform) {
    const auto result =
        particle_simulation(test::plane(20'000), {.target_size = 500, .adaptivity = 1});
    EXPECT_LT(spacing_of(result.positions).variation, 0.06);
}

TEST(ParticleSimulation, GivesTheSameBytesForAnyNumberOfThreads) {
    const PointCloud cloud = test::with_attributes(lopsided_sphere(20'000));
    ParticleSimulationOptions options{.target_size = 3000, .adaptivity = 0.5};
    options.regions.push_back({.where = DensityRegion::Sphere{{0, 0, 1}, 0.5}, .density = 4});
    RunContext one, eight;
    one.threads = 1;
    eight.threads = 8;
    const auto a = particle_simulation(cloud, options, one);
    const auto b = particle_simulation(cloud, options, eight);
    EXPECT_EQ(a.positions, b.positions);
    EXPECT_EQ(a.colors, b.colors);
    EXPECT_EQ(a.attributes[0].values, b.attributes[0].values);
}

TEST(ParticleSimulation, ASeedChoosesAnotherResult) {
    const PointCloud cloud = test::sphere(5000);
    const auto run = [&](std::uint64_t seed) {
        return particle_simulation(cloud, {.target_size = 100, .seed = seed}).positions;
    };
    EXPECT_EQ(run(5), run(5));
    EXPECT_NE(run(5), run(6));
}

TEST(ParticleSimulation, GivesAnyCountOfAFewPoints) {
    for (std::size_t n = 1; n <= 6; ++n) {
        for (const PointCloud& cloud : {test::cube(n), test::line(n)}) {
            for (const std::uint64_t target : {1U, 2U, 3U, 5U, 6U, 50U}) {
                const auto result = particle_simulation(cloud, {.target_size = target});
                ASSERT_EQ(result.size(), target);
                for (const Vec3f& p : result.positions) {
                    EXPECT_TRUE(p.allFinite());
                    EXPECT_LT(p.cwiseAbs().maxCoeff(), 3.0F);
                }
            }
        }
    }
}

TEST(ParticleSimulation, KeepsParticlesOfALineOnIt) {
    const auto result = particle_simulation(test::line(1000), {.target_size = 50});
    ASSERT_EQ(result.size(), 50U);
    const Vec3f direction = Vec3f(1, 2, -1).normalized();
    for (const Vec3f& p : result.positions)
        EXPECT_LT((p - direction * direction.dot(p)).norm(), 1e-3F);
}

TEST(ParticleSimulation, PutsNoTwoOfNearlyAllPointsOfALineAtOnePlace) {
    const PointCloud line = test::line(5'000);
    std::vector<Vec3f> found = particle_simulation(line, {.target_size = 4'990}).positions;
    const auto comes_before = [](const Vec3f& a, const Vec3f& b) {
        return std::ranges::lexicographical_compare(a, b);
    };
    std::ranges::sort(found, comes_before);
    EXPECT_EQ(std::ranges::adjacent_find(found), found.end());
}

TEST(ParticleSimulation, KeepsTheColoursOfTheSidesOfAWallApart) {
    constexpr std::size_t kPoints = 40'000;
    PointCloud wall = test::wall(kPoints, 2 / std::sqrt(kPoints / 2.0F));
    const auto mixed = [&wall] {
        return std::ranges::count_if(
            particle_simulation(wall, {.target_size = 1'500}).colors,
            [](const Rgba8& color) { return color.r != 0 && color.b != 0; });
    };
    EXPECT_LT(mixed(), 40);
    for (const Vec3f& p : wall.positions) wall.normals.emplace_back(0, 0, p.z() > 0 ? 1 : -1);
    EXPECT_LT(mixed(), 8);
}

TEST(ParticleSimulation, WorksFarFromTheOriginAndAtAnyScale) {
    for (const float scale : {1e-15F, 1e15F}) {
        PointCloud cloud = test::sphere(5000);
        for (Vec3f& p : cloud.positions) p *= scale;
        EXPECT_LT(spacing_of(particle_simulation(cloud, {.target_size = 200}).positions).variation,
                  0.06);
    }
    PointCloud cloud = test::sphere(5000);
    for (Vec3f& p : cloud.positions) p = p * 1000.0F + Vec3f(1e6F, -1e6F, 1e6F);
    EXPECT_LT(spacing_of(particle_simulation(cloud, {.target_size = 200}).positions).variation,
              0.06);
}

TEST(ParticleSimulation, SeveralPartsEachGetTheirShare) {
    PointCloud cloud = test::sphere(10'000);
    for (const Vec3f& p : test::sphere(3000).positions)
        cloud.positions.push_back(0.5F * p + Vec3f(5, 0, 0));
    const auto result = particle_simulation(cloud, {.target_size = 1000});
    const auto small = count_within(result.positions, [](const Vec3f& p) { return p.x() > 3; });
    EXPECT_NEAR(static_cast<double>(small), 200.0, 15.0);  // a fifth of the area
}

TEST(ParticleSimulation, StrayPointsDoNotMoveTheOthers) {
    PointCloud cloud = test::sphere(10'000);
    for (const Vec3f& p : test::cube(40).positions)
        cloud.positions.push_back(60.0F * p + Vec3f(20, 20, 20));
    std::vector<Vec3f> near;
    for (const Vec3f& p : particle_simulation(cloud, {.target_size = 3'000}).positions)
        if (p.norm() < 1.5F) near.push_back(p);
    EXPECT_GT(near.size(), 2'900U);
    EXPECT_LT(spacing_of(near).variation, 0.06);
}

TEST(ParticleSimulation, StrayPointsHaveNoMoreParticlesThanOthers) {
    constexpr std::size_t kPoints = 10'000;
    for (const std::size_t strays : {20U, 100U}) {
        for (const float reach : {2.0F, 20.0F}) {
            PointCloud cloud = test::sphere(kPoints);
            std::mt19937 random(3);
            std::normal_distribution<float> along(0, reach);
            for (std::size_t i = 0; i < strays; ++i)
                cloud.positions.push_back({along(random), along(random), along(random)});
            for (const std::uint64_t count : {std::uint64_t{2'500}, std::uint64_t{25'000}}) {
                const auto result = particle_simulation(cloud, {.target_size = count});
                const auto far = count_within(
                    result.positions, [](const Vec3f& p) { return std::abs(p.norm() - 1) > 0.1F; });
                const double due = static_cast<double>(strays * count) / kPoints;
                EXPECT_LT(static_cast<double>(far), 4.1 * due)  // some had nearly all
                    << strays << " strays, " << reach << ", " << count;
            }
        }
    }
}

TEST(ParticleSimulation, SpacesARealScanAsEvenlyAsPoissonDisks) {
    const auto file = test::shared_file("models/bun_zipper.ply");
    if (!file) GTEST_SKIP() << "the shared scans are not here";
    PointCloud cloud = read_cloud(*file, {});
    clean(cloud);
    const Spacing spacing = spacing_of(particle_simulation(cloud, {.target_size = 1500}).positions);
    EXPECT_LT(spacing.variation, 0.06);
    EXPECT_GT(spacing.smallest, 0.85);
}

TEST(ParticleSimulation, ReportsProgressAndStopsWhenAsked) {
    const PointCloud cloud = test::sphere(20'000);
    std::vector<double> fractions;
    RunContext watched;
    watched.progress = [&](double f) { fractions.push_back(f); };
    particle_simulation(cloud, {.target_size = 500}, watched);
    EXPECT_TRUE(std::ranges::is_sorted(fractions));
    EXPECT_GT(fractions.size(), 10U);
    EXPECT_EQ(fractions.back(), 1.0);

    for (const double at : {0.0, 0.25, 0.5, 0.9}) {
        std::stop_source stop;
        RunContext context;
        context.stop = stop.get_token();
        context.progress = [&](double f) {
            if (f >= at) stop.request_stop();
        };
        EXPECT_THROW(particle_simulation(cloud, {.target_size = 500}, context), Cancelled);
    }
}

TEST(ParticleSimulation, RefusesOptionsOutOfRange) {
    const PointCloud cloud = test::with_attributes(test::sphere(100));
    const auto refuses = [&](const ParticleSimulationOptions& options, std::string_view part) {
        test::expect_refused(part, [&] { particle_simulation(cloud, options); });
    };
    test::expect_refused("the cloud has no points",
                         [&] { particle_simulation({}, {.target_size = 5}); });
    refuses({}, "target_size 0: expected 1..4294967295");
    refuses({.target_size = std::uint64_t{1} << 32U}, "target_size 4294967296: expected 1..");
    refuses({.target_size = 5, .adaptivity = -0.1}, "adaptivity -0.1: expected 0 to 1");
    refuses({.target_size = 5, .adaptivity = 1.1}, "adaptivity 1.1: expected 0 to 1");
    refuses({.target_size = 5, .max_grading = 0.9},
            "max_grading 0.9: expected a finite number, at least 1");
    refuses({.target_size = 5, .max_iterations = 0}, "max_iterations 0: expected at least 1");
    refuses({.target_size = 5, .tolerance = 0}, "tolerance 0: expected above 0, below 1");
    refuses({.target_size = 5, .reductions = {{"absent", Reduction::Mean}}},
            "reductions: no attribute absent");
    const auto refuses_region = [&](const DensityRegion& region, const std::string& part) {
        refuses({.target_size = 5, .regions = {region}}, "regions[0]: " + part);
    };
    for (const double density : {0.0, 1e-60, 1e300})
        refuses_region({.where = DensityRegion::Sphere{}, .density = density}, "density ");
    refuses_region({.where = DensityRegion::Sphere{}, .density = 2, .transition = -1},
                   "transition -1: expected at least 0");
    refuses_region({.where = DensityRegion::Sphere{.radius = 0}}, "radius 0: expected above 0");
    refuses_region({.where = DensityRegion::Box{{1, 0, 0}, {0, 1, 1}}}, "box: min 1 0 0 above max");
    refuses_region({.where = DensityRegion::Scalar{"absent", 0, 1}}, "no attribute absent");
    refuses_region({.where = DensityRegion::Scalar{"height", 1, 0}}, "low 1 and high 0");
}

}  // namespace
}  // namespace stipple
