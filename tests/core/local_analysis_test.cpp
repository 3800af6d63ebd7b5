#include "stipple/local_analysis.hpp"

#include "stipple/error.hpp"
#include "support/eigen_system.hpp"
#include "support/expect_error.hpp"
#include "support/oracles.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <cmath>
#include <random>

namespace stipple {
namespace {

LocalAnalysis all_of(const std::vector<Vec3f>& points, unsigned k, const RunContext& context = {}) {
    return analyze_locally(
        points, {.k = k, .normals = true, .variation = true, .density = true, .anisotropy = true},
        context);
}

void expect_sound(const LocalAnalysis& analysis) {
    for (std::size_t i = 0; i < analysis.normals.size(); ++i) {
        ASSERT_NEAR(analysis.normals[i].norm(), 1.0F, 1e-5F);
        ASSERT_GE(analysis.variation[i], 0.0F);
        ASSERT_LE(analysis.variation[i], 1.0F / 3.0F + 1e-6F);
        ASSERT_TRUE(std::isfinite(analysis.density[i]));
        ASSERT_GE(analysis.anisotropy[i], 0.0F);
        ASSERT_LE(analysis.anisotropy[i], 1.0F);
    }
}

/// Degrees between two lines.
double angle_deg(const Vec3f& a, const Vec3f& b) {
    return std::asin(std::min(1.0, a.cast<double>().cross(b.cast<double>()).norm())) * 180.0 / M_PI;
}

/// A quarter of a cube's surface about one of its edges, the z axis: faces x = 0 and y = 0.
std::vector<Vec3f> edge(double noise, std::uint64_t seed = 1) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> along(0, 1);
    std::normal_distribution<double> off(0, noise);
    std::vector<Vec3f> points;
    for (int i = 0; i < 4000; ++i) {
        const double a = along(random), z = along(random), d = noise > 0 ? off(random) : 0.0;
        points.push_back((i % 2 == 0 ? Vec3d(d, a, z) : Vec3d(a, d, z)).cast<float>());
    }
    return points;
}

double mean_angle_to_faces_deg(const std::vector<Vec3f>& points, unsigned k) {
    const LocalAnalysis analysis = analyze_locally(points, {.k = k});
    double sum = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
        sum += angle_deg(analysis.normals[i], i % 2 == 0 ? Vec3f::UnitX() : Vec3f::UnitY());
    return sum / static_cast<double>(points.size());
}

TEST(SurfaceVariation, IsZeroOnAPlane) {
    EXPECT_EQ(surface_variation({0, 2, 5}), 0.0);
}
TEST(SurfaceVariation, IsOneThirdForAnIsotropicNeighborhood) {
    EXPECT_DOUBLE_EQ(surface_variation({4, 4, 4}), 1.0 / 3.0);
}
TEST(SurfaceVariation, IsTheShareOfTheLeastEigenvalue) {
    EXPECT_DOUBLE_EQ(surface_variation({1, 3, 6}), 0.1);
}
TEST(SurfaceVariation, IsZeroWhereAllPointsCoincide) {
    EXPECT_EQ(surface_variation({0, 0, 0}), 0.0);
}

TEST(LocalAnalysis, IsThatOfTheCovarianceMatrix) {
    const std::vector<Vec3f> points = test::sphere(800, 0.05).positions;
    constexpr std::size_t k = 14;
    const LocalAnalysis analysis = all_of(points, k);
    for (std::size_t i = 0; i < points.size(); ++i) {
        const auto near = test::sorted_distances(points, i);
        Eigen::Matrix<double, 3, k + 1> members;
        members.col(k) = points[i].cast<double>();
        for (std::size_t j = 0; j < k; ++j)
            members.col(static_cast<Eigen::Index>(j)) = points[near[j].second].cast<double>();
        members.colwise() -= members.rowwise().mean().eval();
        const auto [lambda, vectors] = test::eigen_system(members * members.transpose());
        ASSERT_NEAR(analysis.variation[i], lambda[0] / lambda.sum(), 1e-7);
        ASSERT_NEAR(analysis.anisotropy[i], (lambda[2] - lambda[1]) / lambda[2], 1e-6);
        ASSERT_FLOAT_EQ(analysis.density[i], static_cast<float>(k) / near[k - 1].first);
        const Vec3d expected = vectors.col(0);
        const double gap = (lambda[1] - lambda[0]) / lambda[2];
        ASSERT_LT(expected.cross(analysis.normals[i].cast<double>()).norm(), 1e-6 + 1e-12 / gap);
    }
}

TEST(LocalAnalysis, FindsTheNormalOfAPlane) {
    const Vec3f normal = Vec3f(1, 2, 3).normalized();
    const Eigen::AngleAxisf turn(std::acos(normal.z()), Vec3f::UnitZ().cross(normal).normalized());
    std::vector<Vec3f> points = test::plane(500).positions;
    for (Vec3f& p : points) p = turn * p;
    const LocalAnalysis analysis = all_of(points, 12);
    for (std::size_t i = 0; i < points.size(); ++i) {
        ASSERT_LT(angle_deg(analysis.normals[i], normal), 1e-3);
        ASSERT_LT(analysis.variation[i], 1e-9F);
    }
}

TEST(LocalAnalysis, IsIsotropicAmongTheCornersOfAnOctahedron) {
    const std::vector<Vec3f> points = {{0, 0, 0},  {2, 0, 0}, {-2, 0, 0}, {0, 2, 0},
                                       {0, -2, 0}, {0, 0, 2}, {0, 0, -2}};
    const LocalAnalysis analysis = all_of(points, 6);
    EXPECT_FLOAT_EQ(analysis.variation[0], 1.0F / 3.0F);
    EXPECT_FLOAT_EQ(analysis.density[0], 6.0F / 4.0F);
    EXPECT_FLOAT_EQ(analysis.anisotropy[0], 0.0F);
}

TEST(LocalAnalysis, SeesThatPointsOnALineLieAlongIt) {
    const std::vector<Vec3f> points = test::line(100).positions;
    const LocalAnalysis analysis = all_of(points, 8);
    expect_sound(analysis);
    const Vec3f along = (points.back() - points.front()).normalized();
    for (std::size_t i = 0; i < points.size(); ++i) {
        ASSERT_LT(std::abs(along.dot(analysis.normals[i])), 1e-3F);
        ASSERT_NEAR(analysis.anisotropy[i], 1.0F, 1e-6F);
        ASSERT_NEAR(analysis.variation[i], 0.0F, 1e-6F);
    }
}

TEST(LocalAnalysis, IsSoundForDegenerateClouds) {
    for (const unsigned k : {0U, 3U, 16U}) {
        for (std::size_t n = 0; n < 12; ++n) {
            expect_sound(all_of(test::cube(n).positions, k));
            expect_sound(all_of(std::vector<Vec3f>(n, Vec3f(1, 2, 3)), k));
        }
        expect_sound(all_of({{0, 0, 0}, {0, 0, 0}, {1e30F, 0, 0}, {0, -3e38F, 3e38F}}, k));
    }
}

TEST(LocalAnalysis, OfAPointThatIsAloneIsFlat) {
    const LocalAnalysis analysis = all_of({{1, 2, 3}}, 16);
    EXPECT_EQ(analysis.normals[0], Vec3f::UnitZ());
    EXPECT_EQ(analysis.variation[0], 0.0F);
    EXPECT_EQ(analysis.density[0], 0.0F);
}

TEST(LocalAnalysis, DoesNotDependOnTheUnit) {
    std::vector<Vec3f> points = test::sphere(700, 0.05).positions;
    const LocalAnalysis here = all_of(points, 16);
    for (Vec3f& p : points) p *= 0x1p-50F;
    const LocalAnalysis tiny = all_of(points, 16);
    EXPECT_EQ(here.normals, tiny.normals);
    EXPECT_EQ(here.variation, tiny.variation);
}

TEST(LocalAnalysis, IsTheSameForAnyNumberOfThreads) {
    const std::vector<Vec3f> points = test::sphere(20'000, 0.01).positions;
    for (const unsigned k : {0U, 16U}) {
        const LocalAnalysis one = all_of(points, k, {.threads = 1});
        const LocalAnalysis eight = all_of(points, k, {.threads = 8});
        EXPECT_EQ(one.normals, eight.normals);
        EXPECT_EQ(one.variation, eight.variation);
        EXPECT_EQ(one.density, eight.density);
    }
}

TEST(LocalAnalysis, LeavesOutWhatWasNotAskedFor) {
    const LocalAnalysis analysis =
        analyze_locally(test::cube(50).positions, {.normals = false, .variation = true});
    EXPECT_TRUE(analysis.normals.empty());
    EXPECT_EQ(analysis.variation.size(), 50U);
    EXPECT_TRUE(analysis.density.empty());
    EXPECT_TRUE(analysis.anisotropy.empty());
}

TEST(LocalAnalysis, RefusesTooSmallAndTooLargeNeighborhoods) {
    for (const unsigned k : {1U, 2U, 65U})
        test::expect_refused(": expected 3..64 neighbours, or 0 to choose for each point",
                             [&] { analyze_locally(test::cube(100).positions, {.k = k}); });
}

TEST(LocalAnalysis, StopsWhenAsked) {
    std::stop_source source;
    source.request_stop();
    EXPECT_THROW(analyze_locally(test::sphere(5000).positions, {}, {.stop = source.get_token()}),
                 Cancelled);
}

TEST(ChosenNeighborhoods, GrowUnderNoise) {
    std::vector<Vec3f> points = test::plane(3000).positions;
    std::mt19937_64 random(5);
    std::normal_distribution<float> noise(0, 0.01F);
    for (Vec3f& p : points) p.z() += noise(random);
    const auto mean_angle = [&](unsigned k) {
        const LocalAnalysis analysis = analyze_locally(points, {.k = k});
        double sum = 0;
        for (const Vec3f& normal : analysis.normals) sum += angle_deg(normal, Vec3f::UnitZ());
        return sum / static_cast<double>(points.size());
    };
    EXPECT_LT(mean_angle(0), 0.7 * mean_angle(16));
}

TEST(ChosenNeighborhoods, StaySmallBesideAnEdge) {
    const std::vector<Vec3f> points = edge(0.0);
    EXPECT_LT(mean_angle_to_faces_deg(points, 0), 0.8 * mean_angle_to_faces_deg(points, 32));
}

TEST(ChosenNeighborhoods, AreBetterThanAnyOneSizeOnANoisyEdge) {
    const std::vector<Vec3f> points = edge(0.004);
    const double chosen = mean_angle_to_faces_deg(points, 0);
    for (const unsigned k : {8U, 16U, 32U, 64U})
        EXPECT_LT(chosen, mean_angle_to_faces_deg(points, k)) << k;
}

}  // namespace
}  // namespace stipple
