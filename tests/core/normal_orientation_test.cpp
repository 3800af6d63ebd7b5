#include "stipple/normal_orientation.hpp"

#include "stipple/error.hpp"
#include "stipple/local_analysis.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <functional>
#include <random>

namespace stipple {
namespace {

using Field = std::function<Vec3f(const Vec3f&)>;

/// Estimated normals, each in a direction of chance.
std::vector<Vec3f> unoriented_normals(const std::vector<Vec3f>& points) {
    std::vector<Vec3f> normals = analyze_locally(points, {.k = 10}).normals;
    std::mt19937 random(3);
    for (Vec3f& n : normals) {
        if (random() % 2 == 0) n = -n;
    }
    return normals;
}

/// The share of normals that point as `outward` does.
double share_outward(const std::vector<Vec3f>& points, const std::vector<Vec3f>& normals,
                     const Field& outward) {
    double count = 0;
    for (std::size_t i = 0; i < points.size(); ++i) count += normals[i].dot(outward(points[i])) > 0;
    return count / static_cast<double>(points.size());
}

double share_after_orientation(const std::vector<Vec3f>& points, const Field& outward) {
    std::vector<Vec3f> normals = unoriented_normals(points);
    orient_normals(points, normals, {.k = 10});
    return share_outward(points, normals, outward);
}

/// n points at random in a rectangle of the plane z = 0, the longer side along x.
std::vector<Vec3f> sheet(std::size_t n, float length, std::uint64_t seed) {
    std::vector<Vec3f> points = test::plane(n, seed).positions;
    for (Vec3f& p : points) p.x() *= length;
    return points;
}

TEST(NormalOrientation, TurnsASphereOutward) {
    EXPECT_EQ(share_after_orientation(test::sphere(5000, 0.01).positions,
                                      [](const Vec3f& p) { return p; }),
              1.0);
}

TEST(NormalOrientation, TurnsEachOfSeveralPartsOutward) {
    std::vector<Vec3f> points;
    for (const Vec3f& p : test::sphere(2000).positions) {
        points.push_back(p);
        points.push_back(0.5F * p + Vec3f(10, 0, 0));
        points.push_back(0.1F * p + Vec3f(0, -20, 3));
    }
    EXPECT_EQ(share_after_orientation(points,
                                      [](const Vec3f& p) -> Vec3f {
                                          if (p.x() > 5) return p - Vec3f(10, 0, 0);
                                          if (p.y() < -5) return p - Vec3f(0, -20, 3);
                                          return p;
                                      }),
              1.0);
}

TEST(NormalOrientation, TurnsTerrainUp) {
    std::vector<Vec3f> points = sheet(4000, 2, 1);
    for (Vec3f& p : points) p.z() = 0.1F * std::sin(9 * p.x()) * std::cos(7 * p.y());
    EXPECT_EQ(share_after_orientation(points, [](const Vec3f&) { return Vec3f(0, 0, 1); }), 1.0);
}

TEST(NormalOrientation, KeepsTheSidesOfAThinPlateApart) {
    constexpr float kHeight = 0.06F;  // about two spacings; the neighbours of many lie across
    std::vector<Vec3f> points;
    for (Vec3f p : test::plane(3000, 1).positions) points.push_back(p);
    for (Vec3f p : test::plane(3000, 2).positions) points.emplace_back(p.x(), p.y(), kHeight);
    for (const Vec3f& p : test::plane(800, 3).positions) {  // and the rim
        const float side = p.x() < 0.5F ? 0.0F : 1.0F, along = std::fmod(2 * p.x(), 1.0F);
        points.emplace_back(side, along, kHeight * p.y());
        points.emplace_back(along, side, kHeight * p.y());
    }
    const Field outward = [](const Vec3f& p) -> Vec3f {
        if (p.z() == 0.0F) return -Vec3f::UnitZ();
        if (p.z() == kHeight) return Vec3f::UnitZ();
        if (p.x() == 0.0F || p.x() == 1.0F) return (p.x() - 0.5F) * Vec3f::UnitX();
        return (p.y() - 0.5F) * Vec3f::UnitY();
    };
    EXPECT_GT(share_after_orientation(points, outward), 0.98);
}

TEST(NormalOrientation, TurnsTowardsAViewpoint) {
    const std::vector<Vec3f> points = test::sphere(1000).positions;
    std::vector<Vec3f> normals = unoriented_normals(points);
    const Vec3d viewpoint = {3, 1, -2};
    orient_normals(points, normals, {.viewpoint = viewpoint});
    EXPECT_EQ(share_outward(points, normals,
                            [&](const Vec3f& p) -> Vec3f { return viewpoint.cast<float>() - p; }),
              1.0);
}

TEST(NormalOrientation, ChangesNothingButSigns) {
    const std::vector<Vec3f> points = test::cube(500).positions;
    const std::vector<Vec3f> before = unoriented_normals(points);
    std::vector<Vec3f> after = before;
    orient_normals(points, after);
    for (std::size_t i = 0; i < points.size(); ++i)
        EXPECT_TRUE(after[i] == before[i] || after[i] == -before[i]);
}

TEST(NormalOrientation, DoesNotDependOnTheSignsItIsGiven) {
    const std::vector<Vec3f> points = test::sphere(3000, 0.03).positions;
    std::vector<Vec3f> a = unoriented_normals(points), b = a;
    for (std::size_t i = 0; i < b.size(); i += 3) b[i] = -b[i];
    orient_normals(points, a);
    orient_normals(points, b);
    EXPECT_EQ(a, b);
}

TEST(NormalOrientation, IsTheSameForAnyNumberOfThreads) {
    const std::vector<Vec3f> points = test::sphere(30'000, 0.02).positions;
    std::vector<Vec3f> one = unoriented_normals(points), eight = one;
    orient_normals(points, one, {}, {.threads = 1});
    orient_normals(points, eight, {}, {.threads = 8});
    EXPECT_EQ(one, eight);
}

TEST(NormalOrientation, CopesWithTinyAndDegenerateClouds) {
    for (std::size_t n = 0; n < 5; ++n) {
        std::vector<Vec3f> normals(n, -Vec3f::UnitZ());
        orient_normals(std::vector<Vec3f>(n, Vec3f(1, 2, 3)), normals);
        for (const Vec3f& normal : normals) EXPECT_EQ(normal, Vec3f::UnitZ());
    }
    std::vector<Vec3f> normals(40, Vec3f::Zero());
    normals[7] = Vec3f::Constant(NAN);
    orient_normals(test::line(40).positions, normals);
    EXPECT_EQ(normals[0], Vec3f::Zero());
}

TEST(NormalOrientation, RefusesWhatIsOutOfRange) {
    const std::vector<Vec3f> points = test::cube(20).positions;
    std::vector<Vec3f> normals(20, Vec3f::UnitZ()), fewer(19, Vec3f::UnitZ());
    test::expect_refused("19 normals: expected 20, one for each point",
                         [&] { orient_normals(points, fewer); });
    test::expect_refused("k 0: expected 1..64 neighbours",
                         [&] { orient_normals(points, normals, {.k = 0}); });
    test::expect_refused("k 65: expected 1..64 neighbours",
                         [&] { orient_normals(points, normals, {.k = 65}); });
    test::expect_refused("viewpoint: expected finite coordinates",
                         [&] { orient_normals(points, normals, {.viewpoint = Vec3d(0, NAN, 0)}); });
}

TEST(NormalOrientation, StopsWhenAsked) {
    const std::vector<Vec3f> points = test::sphere(5000).positions;
    std::vector<Vec3f> normals(points);
    std::stop_source source;
    source.request_stop();
    EXPECT_THROW(orient_normals(points, normals, {}, {.stop = source.get_token()}), Cancelled);
}

}  // namespace
}  // namespace stipple
