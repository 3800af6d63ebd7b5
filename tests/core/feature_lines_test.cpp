#include "stipple/feature_lines.hpp"

#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <random>
#include <string_view>

namespace stipple {
namespace {

/// n points at random on the surface of the cube [0, 1]^3, moved by normal noise.
std::vector<Vec3f> cube_surface(std::size_t n, float noise = 0, std::uint64_t seed = 1) {
    std::mt19937_64 random(seed);
    std::normal_distribution<float> off(0, 1);
    std::vector<Vec3f> points = test::plane(n, seed).positions;
    for (std::size_t i = 0; i < n; ++i) {
        const float u = points[i].x(), v = points[i].y(), w = i % 2 == 0 ? 0.0F : 1.0F;
        points[i] = i % 6 < 2 ? Vec3f(w, u, v) : i % 6 < 4 ? Vec3f(u, w, v) : Vec3f(u, v, w);
        if (noise > 0) points[i] += noise * Vec3f(off(random), off(random), off(random));
    }
    return points;
}

/// Of the unit cube.
float distance_to_nearest_edge(const Vec3f& p) {
    Vec3f to_side = p.array().abs().min((p.array() - 1.0F).abs());
    const float farthest = to_side.maxCoeff();
    return std::sqrt(std::max(0.0F, to_side.squaredNorm() - farthest * farthest));
}

float distance_to_segment(const Vec3f& p, const Vec3f& a, const Vec3f& b) {
    const Vec3f along = b - a;
    const float t = std::clamp((p - a).dot(along) / along.squaredNorm(), 0.0F, 1.0F);
    return (p - a - t * along).norm();
}

float distance_to_lines(const Vec3f& p, const std::vector<Vec3f>& points,
                        const FeatureLines& lines) {
    float least = INFINITY;
    for (std::size_t l = 0; l < lines.size(); ++l) {
        const auto line = lines.line(l);
        for (std::size_t i = 1; i < line.size(); ++i)
            least = std::min(least, distance_to_segment(p, points[line[i - 1]], points[line[i]]));
    }
    return least;
}

void expect_lines_along_the_edges_of_the_cube(const std::vector<Vec3f>& points) {
    const FeatureLines lines = find_feature_lines(points);
    ASSERT_GT(lines.size(), 0U);
    const float spacing = std::sqrt(6.0F / static_cast<float>(points.size()));
    for (const Index i : lines.points)
        EXPECT_LT(distance_to_nearest_edge(points[i]), 3.5F * spacing);
    // All 12 edges have a line beside them, but for a gap where it may not reach a corner.
    std::size_t beside = 0, all = 0;
    for (int axis = 0; axis < 3; ++axis) {
        for (const auto& [u, v] : {std::pair(0, 0), {0, 1}, {1, 0}, {1, 1}}) {
            std::size_t here = 0;
            for (int step = 0; step <= 50; ++step, ++all) {
                Vec3f p;
                p[axis] = static_cast<float>(step) / 50.0F;
                p[(axis + 1) % 3] = static_cast<float>(u);
                p[(axis + 2) % 3] = static_cast<float>(v);
                here += distance_to_lines(p, points, lines) < 3 * spacing ? 1 : 0;
            }
            EXPECT_GT(here, 40U) << "axis " << axis << ", " << u << v;
            beside += here;
        }
    }
    EXPECT_GT(static_cast<double>(beside), 0.95 * static_cast<double>(all));
}

TEST(FeatureLines, FollowTheTwelveEdgesOfACube) {
    expect_lines_along_the_edges_of_the_cube(cube_surface(12'000));
}
TEST(FeatureLines, FollowTheTwelveEdgesOfANoisyCube) {
    expect_lines_along_the_edges_of_the_cube(cube_surface(12'000, 0.004F));
}
TEST(FeatureLines, AreNoneOnASphere) {
    const FeatureLines lines = find_feature_lines(test::sphere(8000, 0.005).positions);
    EXPECT_EQ(lines.size(), 0U);
    EXPECT_EQ(lines.weights.size(), 8000U);
}
TEST(FeatureLines, AreNoneOnANoisyPlane) {
    std::vector<Vec3f> points = test::plane(5000).positions;
    std::mt19937_64 random(2);
    std::normal_distribution<float> off(0, 0.005F);  // a third of the spacing
    for (Vec3f& p : points) p.z() += off(random);
    EXPECT_EQ(find_feature_lines(points).size(), 0U);
}

TEST(FeatureLines, CloseTheLoopOfARim) {
    // A tin: the rims of its lid and its bottom are two circles.
    std::mt19937_64 random(4);
    std::uniform_real_distribution<double> unit(0, 1);
    std::vector<Vec3f> points;
    for (int i = 0; i < 8000; ++i) {
        const double angle = 2 * M_PI * unit(random), u = unit(random);
        const double ring = i % 2 == 0 ? 1.0 : std::sqrt(u), z = i % 2 == 0 ? u : (i / 2) % 2;
        points.push_back(Vec3d(ring * std::cos(angle), ring * std::sin(angle), z).cast<float>());
    }
    const FeatureLines lines = find_feature_lines(points);
    ASSERT_EQ(lines.size(), 2U);
    for (std::size_t l = 0; l < 2; ++l) EXPECT_EQ(lines.line(l).front(), lines.line(l).back());
}

TEST(FeatureWeights, GrowTowardsAnEdge) {
    const std::vector<Vec3f> points = cube_surface(12'000);
    const FeatureLines lines = find_feature_lines(points);
    const float spacing = std::sqrt(6.0F / 12'000.0F);
    for (std::size_t i = 0; i < points.size(); ++i) {
        const float distance = distance_to_nearest_edge(points[i]);
        if (distance > 6 * spacing) {
            EXPECT_EQ(lines.weights[i], 0.0F);
        }
        if (distance < 0.3F * spacing) {
            EXPECT_GT(lines.weights[i], 0.4F);
        }
    }
}

TEST(FeatureLines, AreTheSameForAnyNumberOfThreads) {
    const std::vector<Vec3f> points = cube_surface(12'000, 0.002F);
    const FeatureLines one = find_feature_lines(points, {}, {.threads = 1});
    const FeatureLines eight = find_feature_lines(points, {}, {.threads = 8});
    EXPECT_EQ(one.weights, eight.weights);
    EXPECT_EQ(one.points, eight.points);
    EXPECT_EQ(one.offsets, eight.offsets);
}

TEST(FeatureLines, AreNoneInTinyAndDegenerateClouds) {
    for (std::size_t n = 0; n < 8; ++n)
        EXPECT_EQ(find_feature_lines(std::vector<Vec3f>(n, Vec3f(1, 2, 3))).size(), 0U);
    EXPECT_EQ(find_feature_lines(std::vector<Vec3f>(500, Vec3f(1, 2, 3))).size(), 0U);
    EXPECT_EQ(find_feature_lines(test::line(300).positions).size(), 0U);
}

TEST(FeatureLines, RefuseOptionsOutOfRange) {
    const std::vector<Vec3f> points = test::cube(50).positions;
    const auto refuses = [&](const FeatureLineOptions& options, std::string_view part) {
        test::expect_refused(part, [&] { find_feature_lines(points, options); });
    };
    refuses({.variation = 0}, "variation 0: expected more than 0, less than 1/3");
    refuses({.variation = 0.4}, "variation 0.4: expected more than 0, less than 1/3");
    refuses({.high = 1.5}, "high 1.5: expected more than 0, at most 1");
    refuses({.low = 0.8}, "low 0.8: expected more than 0, at most high");
    refuses({.low = NAN}, "low nan: expected more than 0, at most high");
    refuses({.min_links = 1}, "min_links 1: expected 2..1000");
}

}  // namespace
}  // namespace stipple
