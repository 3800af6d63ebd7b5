#include "particles/particle_relaxation.hpp"

#include "cloud/hilbert_order.hpp"
#include "particles/particle_spread.hpp"
#include "particles/particle_surface.hpp"
#include "particles/surface_samples.hpp"
#include "support/square_grid.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>

namespace stipple {
namespace {

/// What particles move on. Everything is in its frame, where a unit square is 2 wide.
struct Ground {
    explicit Ground(const PointCloud& cloud)
        : frame(cloud.positions),
          samples(sample_surface(cloud, hilbert_order(cloud.positions, {}), frame, {})),
          mls(cloud.positions, MlsOptions{}, {}),
          surface(samples, mls, frame, {}) {}

    Index nearest(const Vec3f& p) const {
        const auto distance_sq = [&](const Vec3f& q) { return (q - p).squaredNorm(); };
        return static_cast<Index>(std::ranges::min_element(samples.positions, {}, distance_sq) -
                                  samples.positions.begin());
    }

    ParticleFrame frame;
    SurfaceSamples samples;
    MlsSurface mls;
    ParticleSurface surface;
};

TEST(Repulsion, IsAsLongAsTheRadiusLessTheDistance) {
    const Vec3f f = repulsion({1, 0, 0}, {0, 0, 0}, 1.5F);
    EXPECT_FLOAT_EQ(f.x(), 0.5F);
    EXPECT_EQ(f.y(), 0);
    EXPECT_EQ(f.z(), 0);
    const Vec3f slanted = repulsion({0, 0, 0}, {3, 4, 0}, 10.0F);
    EXPECT_FLOAT_EQ(slanted.x(), -3.0F);
    EXPECT_FLOAT_EQ(slanted.y(), -4.0F);
}

TEST(Repulsion, IsZeroFromTheRadiusOnAndWhereParticlesCoincide) {
    EXPECT_EQ(repulsion({2, 0, 0}, {0, 0, 0}, 2.0F), Vec3f::Zero());
    EXPECT_EQ(repulsion({5, 0, 0}, {0, 0, 0}, 2.0F), Vec3f::Zero());
    EXPECT_EQ(repulsion({1, 1, 1}, {1, 1, 1}, 2.0F), Vec3f::Zero());
}

TEST(Repulsion, OfTheCornersOfATriangleSumsToAForceFromItsCentre) {
    // Eq. 8, side 1 and r = 2: two forces of length 1 that enclose 60 degrees.
    const float h = std::sqrt(3.0F) / 2;
    const Vec3f a(0, 0, 0), b(1, 0, 0), c(0.5F, h, 0);
    const Vec3f total = repulsion(c, a, 2.0F) + repulsion(c, b, 2.0F);
    EXPECT_NEAR(total.x(), 0.0F, 1e-6F);
    EXPECT_NEAR(total.y(), std::sqrt(3.0F), 1e-6F);
}

TEST(ParticleRelaxation, MovesEachByTheForcesOfAllOthers) {
    const PointCloud cloud = test::square_grid(64);
    const Ground ground(cloud);
    constexpr float kSpacing = 0.2F, kForce = 0.35F;
    for (const float radius : {1.25F, 0.88F}) {
        for (std::size_t count = 2; count < 12; ++count) {
            SpreadParticles start;
            for (const Vec3f& p : test::plane(count, 7).positions)
                start.positions.emplace_back(0.3F * p);
            for (const Vec3f& p : start.positions) start.samples.push_back(ground.nearest(p));
            ParticleRelaxation particles(ground.surface, std::vector<float>(cloud.size(), kSpacing),
                                         start, {});
            particles.step(radius, false);
            for (std::size_t i = 0; i < count; ++i) {
                Vec3f force = Vec3f::Zero();
                for (const Vec3f& p : start.positions)
                    force += repulsion(start.positions[i], p, radius * kSpacing);
                Vec3f step = kForce * force;
                if (step.norm() > 0.5F * kSpacing) step *= 0.5F * kSpacing / step.norm();
                EXPECT_LT((particles.positions()[i] - start.positions[i] - step).norm(), 1e-5F)
                    << count << " particles, radius " << radius;
            }
        }
    }
}

TEST(ParticleRelaxation, PartsParticlesThatCoincide) {
    const PointCloud cloud = test::square_grid(64);
    const Ground ground(cloud);
    for (const float radius : {1.25F, 0.88F}) {
        SpreadParticles start;
        for (const float x : {0.0F, 0.0F, 0.05F}) start.positions.emplace_back(x, 0.0F, 0.0F);
        for (const Vec3f& p : start.positions) start.samples.push_back(ground.nearest(p));
        ParticleRelaxation particles(ground.surface, std::vector<float>(cloud.size(), 0.2F), start,
                                     {});
        for (int i = 0; i < 40; ++i) particles.step(radius, false);
        const std::span<const Vec3f> p = particles.positions();
        EXPECT_GT((p[0] - p[1]).norm(), 0.9F * radius * 0.2F) << radius;
    }
}

TEST(ParticleSurface, LeadsToTheNearestSample) {
    for (const std::size_t points : {3U, 6U, 15U, 2'000U}) {
        const PointCloud cloud = test::plane(points, 3);
        const Ground ground(cloud);
        const std::vector<Vec3f> targets = test::plane(100, 4).positions;
        for (std::size_t i = 0; i < targets.size(); ++i) {
            const Vec3f to = 2 * targets[i] - Vec3f(1, 1, 0);
            ParticleSurface::Foot foot{.sample = static_cast<Index>(i % points)};
            foot.slack = -1;  // walks
            ground.surface.project(ground.samples.positions[foot.sample], to, foot);
            const auto distance = [&](Index s) {
                return (ground.samples.positions[s] - to).norm();
            };
            EXPECT_LE(distance(foot.sample), distance(ground.nearest(to))) << points;
        }
    }
}

}  // namespace
}  // namespace stipple
