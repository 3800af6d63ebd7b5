#include "error/foot_finder.hpp"

#include "error/line_foot.hpp"
#include "error/plane_kernels.hpp"
#include "support/eigen_system.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

namespace stipple {
namespace {

/// n random points beside the unit sphere.
std::vector<Vec3f> random_sphere(std::size_t n, double noise, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> height(-noise, noise);
    std::vector<Vec3f> points;
    while (points.size() < n) {
        const Vec3d p(normal(random), normal(random), normal(random));
        points.push_back((p.normalized() * (1 + height(random))).cast<float>());
    }
    return points;
}

/// The fixed point by the letter: all points sorted by distance, everything in doubles.
struct SlowFoot {
    double distance = std::numeric_limits<double>::infinity();
    double h = 0;
    bool converged = false;
};

struct SlowFit {
    Vec3d mean;
    test::EigenSystem axes;
};

SlowFit slow_fit(const std::vector<Vec3d>& near, const Vec3d& x, double h) {
    const auto weight = [&](const Vec3d& p) { return std::exp(-(p - x).squaredNorm() / (h * h)); };
    double total = 0;
    Vec3d mean = Vec3d::Zero();
    for (const Vec3d& p : near) {
        total += weight(p);
        mean += weight(p) * p;
    }
    mean /= total;
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (const Vec3d& p : near) covariance += weight(p) * (p - mean) * (p - mean).transpose();
    return {mean, test::eigen_system(covariance)};
}

SlowFoot slow_foot(const std::vector<Vec3f>& points, unsigned k, const Vec3d& q, Vec3d x,
                   int steps = 200) {
    SlowFoot foot;
    for (int i = 0; i < steps && !foot.converged; ++i) {
        std::vector<Vec3d> near;
        for (const Vec3f& p : points) near.push_back(p.cast<double>());
        std::ranges::partial_sort(near, near.begin() + k, {},
                                  [&](const Vec3d& p) { return (p - x).squaredNorm(); });
        near.resize(k);
        foot.h = (near.back() - x).norm() / 3;
        const SlowFit plane = slow_fit(near, x, foot.h);
        const Vec3d n = plane.axes.vectors.col(0);
        Vec3d next = q - n.dot(q - plane.mean) * n;
        const double line = line_part(plane.axes.values[1] / plane.axes.values[2],
                                      plane.axes.values[0] / plane.axes.values[1]);
        if (line > 0) {
            const double narrow = std::max(line_scale(k) * foot.h, (near.front() - x).norm());
            std::erase_if(near, [&](const Vec3d& p) { return (p - x).norm() > 3 * narrow; });
            const SlowFit fit = slow_fit(near, x, narrow);
            const Vec3d along = fit.axes.vectors.col(2);
            const Vec3d on_line = fit.mean + along.dot(q - fit.mean) * along;
            next += line * (on_line - next);
        }
        foot.converged = (next - x).norm() <= 1e-4 * foot.h;
        foot.distance = (q - next).norm();
        x = next;
    }
    return foot;
}

TEST(FootFinder, FindsTheFixedPointsOfTheSlowForm) {
    const std::vector<Vec3f> target = random_sphere(600, 0.02, 1);
    const PointTree tree(target, PointTree::Leaves::Compact, {});
    for (const unsigned k : {6U, 20U, 40U}) {
        const FootFinder finder(target, tree, {.k = k, .tolerance = 1e-5});
        const std::vector<Vec3f> queries = random_sphere(300, 0.1, 2);
        std::vector<Foot> feet(queries.size());
        finder.find(queries, [&](std::size_t i, const Foot& foot) { feet[i] = foot; }, {});
        int compared = 0, differ = 0;
        for (std::size_t i = 0; i < queries.size(); ++i) {
            const Vec3d q = queries[i].cast<double>();
            const auto& nearest = *std::ranges::min_element(
                target, {}, [&](const Vec3f& p) { return (p - queries[i]).norm(); });
            const SlowFoot direct = slow_foot(target, k, q, q);
            const SlowFoot from_sample = slow_foot(target, k, q, nearest.cast<double>());
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

/// n points of a circle, of which each is off by the noise in all directions.
std::vector<Vec3f> circle(std::size_t n, double noise = 0) {
    std::mt19937_64 random(7);
    std::normal_distribution<double> normal(0, 1);
    std::vector<Vec3f> points;
    for (std::size_t i = 0; i < n; ++i) {
        const double angle = 2 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(n);
        const Vec3d off(normal(random), normal(random), normal(random));
        points.push_back((Vec3d(std::cos(angle), std::sin(angle), 0) + noise * off).cast<float>());
    }
    return points;
}

std::vector<Foot> feet_on(const std::vector<Vec3f>& points, const std::vector<Vec3f>& queries) {
    const PointTree tree(points, PointTree::Leaves::Compact, {});
    std::vector<Foot> feet(queries.size());
    FootFinder(points, tree, {})
        .find(queries, [&](std::size_t i, const Foot& foot) { feet[i] = foot; }, {});
    return feet;
}

TEST(FootFinder, FindsFeetOnWires) {
    std::vector<Vec3f> queries;
    for (int i = 0; i < 500; ++i) {  // in its plane, off it, and both
        const float angle = 0.0123F * static_cast<float>(i), off = 0.03F;
        const float away = i % 3 == 0 ? 0.0F : off, up = i % 3 == 1 ? 0.0F : off;
        queries.emplace_back((1 + away) * std::cos(angle), (1 + away) * std::sin(angle), up);
    }
    for (const double noise : {0.0, 2e-5}) {
        const std::vector<Foot> feet = feet_on(circle(1'000, noise), queries);
        for (std::size_t i = 0; i < feet.size(); ++i) {
            const Vec3d q = queries[i].cast<double>();
            const double distance = std::hypot(std::hypot(q.x(), q.y()) - 1, q.z());
            EXPECT_NEAR(feet[i].distance, distance, 1e-4 + 4 * noise) << i << ' ' << noise;
            EXPECT_NEAR((feet[i].point - q).norm(), feet[i].distance, 1e-6);
            EXPECT_TRUE(feet[i].on_surface()) << i << ' ' << noise;
        }
    }
}

TEST(FootFinder, FindsFeetBetweenThePointsOfAStraightLine) {
    std::vector<Vec3f> points, queries;
    for (int i = 0; i < 100; ++i) points.emplace_back(static_cast<float>(i), 0.0F, 0.0F);
    for (int i = 10; i < 890; ++i) queries.emplace_back(0.1F * static_cast<float>(i), 0.25F, 0.0F);
    for (const Foot& foot : feet_on(points, queries)) EXPECT_NEAR(foot.distance, 0.25, 1e-5);
}

TEST(FootFinder, FindsTheSurfaceBetweenTheLinesOfAScan) {
    // Ten times as dense along the lines: most neighbours are of one line, with some noise.
    std::mt19937_64 random(3);
    std::normal_distribution<float> normal(0, 0.001F);
    std::vector<Vec3f> points, queries;
    for (int line = 0; line < 20; ++line)
        for (int i = 0; i < 200; ++i)
            points.emplace_back(0.1F * static_cast<float>(i), static_cast<float>(line),
                                normal(random));
    for (int i = 0; i < 500; ++i)
        queries.emplace_back(4 + 0.02F * static_cast<float>(i), 4 + 0.023F * static_cast<float>(i),
                             0.0F);
    double sum = 0;
    for (const Foot& foot : feet_on(points, queries)) sum += foot.distance;
    EXPECT_LT(sum / static_cast<double>(queries.size()), 0.01);  // of lines that are 1 apart
}

TEST(FootFinder, FindsNoFarFootWhereAllNeighboursCoincide) {
    std::vector<Vec3f> points(30, Vec3f(1, 2, 3));
    for (const Foot& foot : feet_on(points, {Vec3f(1, 2, 3), Vec3f(1, 2, 4)}))
        EXPECT_TRUE(std::isfinite(foot.distance));
    EXPECT_EQ(feet_on(points, {Vec3f(1, 2, 4)}).front().distance, 1);
}

TEST(FootFinder, GivesUpNoWalkThatWouldEnd) {
    const std::vector<Vec3f> target = random_sphere(600, 0.6, 4);
    const PointTree tree(target, PointTree::Leaves::Compact, {});
    const FootFinder finder(target, tree, {.k = 12, .max_iterations = 30});
    const std::vector<Vec3f> queries = random_sphere(400, 0.6, 5);
    std::vector<Foot> feet(queries.size());
    finder.find(queries, [&](std::size_t i, const Foot& foot) { feet[i] = foot; }, {});
    int given_up = 0, end = 0;
    for (std::size_t i = 0; i < queries.size(); ++i) {
        if (feet[i].converged) continue;
        ++given_up;
        const Vec3f nearest = finder.nearest_sample(queries[i]);
        end +=
            slow_foot(target, 12, queries[i].cast<double>(), nearest.cast<double>(), 30).converged;
    }
    EXPECT_GT(given_up, 40);
    EXPECT_LE(end, given_up / 20);  // floats lead elsewhere now and then
}

TEST(FootFinder, TakesTheNearerOfTwoSheets) {
    PointCloud cloud = test::plane(5000);
    for (const Vec3f& p : test::plane(5000, 2).positions)
        cloud.positions.push_back(p + Vec3f(0, 0, 0.06F));
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

TEST(FootFinder, CountsTheWayAcrossTheNearestSampleWhereNoWalkEnds) {
    // A ball full of points has no surface that walks from its points would all come to.
    const std::vector<Vec3f> points = random_sphere(2'000, 0.99, 3);
    const PointTree tree(points, PointTree::Leaves::Compact, {});
    const auto feet_of = [&](bool across) {
        std::vector<Foot> feet(points.size());
        FootFinder(points, tree, {.across_sample = across})
            .find(points, [&](std::size_t i, const Foot& foot) { feet[i] = foot; }, {});
        return feet;
    };
    const std::vector<Foot> to_samples = feet_of(false), across_samples = feet_of(true);
    std::size_t endless = 0, off = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        ASSERT_EQ(to_samples[i].converged, across_samples[i].converged);
        if (to_samples[i].converged) {
            ASSERT_EQ(to_samples[i].distance, across_samples[i].distance);
            continue;
        }
        ++endless;
        EXPECT_LE(to_samples[i].distance, 1e-6);  // as if each sample were of the surface
        off += across_samples[i].distance > 1e-3 ? 1 : 0;
        EXPECT_LE(across_samples[i].distance, across_samples[i].h * 3);
    }
    EXPECT_GT(endless, 20U);
    EXPECT_GT(2 * off, endless);
}

TEST(PlaneKernels, GiveTheSameBits) {
    const auto kernels = available_plane_kernels();
    std::mt19937_64 random(3);
    std::uniform_real_distribution<float> unit(-1, 1);
    for (int round = 0; round < 200; ++round) {
        PlaneLanes lanes(6 + static_cast<unsigned>(round % 30), 64);
        const std::size_t size = 40 + static_cast<std::size_t>(round % 20);
        std::array<std::array<std::vector<float>, 3>, PlaneLanes::kLanes> candidates;
        for (std::size_t lane = 0; lane < PlaneLanes::kLanes; ++lane) {
            // A grid in some lanes: equal distances.
            const float step = lane % 2 == 0 ? 0.0F : 0.25F;
            auto& [x, y, z] = candidates[lane];
            for (std::vector<float>* const axis : {&x, &y, &z}) {
                for (std::size_t j = 0; j < size; ++j) {
                    const float v = (axis == &z ? 0.1F : 1.0F) * unit(random);
                    axis->push_back(step > 0 ? step * std::round(v / step) : v);
                }
                axis->resize((size + 7) / 8 * 8, PlaneLanes::kNowhere);
            }
            lanes.candidates[lane] = {x.data(), y.data(), z.data(),
                                      static_cast<std::uint32_t>(x.size() / 8)};
        }
        if (round % 7 == 0) lanes.candidates[5] = {};
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
            EXPECT_EQ(other.breadth, plain.breadth);
            EXPECT_EQ(other.flat, plain.flat);
        }
        for (std::size_t lane = 0; lane < PlaneLanes::kLanes; ++lane) {
            if (lanes.candidates[lane].groups == 0) {
                EXPECT_FALSE(plain.flat[lane]);
                continue;
            }
            const auto& [x, y, z] = candidates[lane];
            std::vector<float> distances;
            for (std::size_t j = 0; j < size; ++j) {
                const Vec3f way(x[j] - lanes.place.x[lane], y[j] - lanes.place.y[lane],
                                z[j] - lanes.place.z[lane]);
                distances.push_back(way.x() * way.x() + way.y() * way.y() + way.z() * way.z());
            }
            std::ranges::sort(distances);
            EXPECT_EQ(plain.radius_sq[lane], distances[lanes.k - 1]);
            EXPECT_EQ(plain.nearest_sq[lane], distances.front());
        }
    }
}

}  // namespace
}  // namespace stipple
