#include "stipple/mls.hpp"

#include "analysis/mls_fit.hpp"
#include "base/kernel_sets.hpp"
#include "stipple/error.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <stop_token>
#include <string>

namespace stipple {
namespace {

using test::sphere;

/// A regular patch of (2 n + 1)^2 points over [-1, 1]^2 of the plane z = 0, lifted by `height`.
std::vector<Vec3f> patch(int n, const std::function<double(double, double)>& height) {
    std::vector<Vec3f> points;
    for (int i = -n; i <= n; ++i) {
        for (int j = -n; j <= n; ++j) {
            const double u = static_cast<double>(i) / n, v = static_cast<double>(j) / n;
            points.push_back(Vec3d(u, v, height(u, v)).cast<float>());
        }
    }
    return points;
}

bool is_finite(const MlsProjection& p) {
    return p.point.allFinite() && p.normal.allFinite() && std::abs(p.normal.norm() - 1.0) < 1e-9;
}

Vec3d random_direction(std::mt19937_64& random) {
    std::normal_distribution<double> normal;
    return Vec3d(normal(random), normal(random), normal(random)).normalized();
}

TEST(MlsSurface, ProjectsOntoAPlaneWhateverTheDegree) {
    const PointCloud cloud = test::plane(2000);
    for (unsigned degree = 0; degree <= 4; ++degree) {
        for (const std::optional<double> h : {std::optional<double>(), std::optional(0.05)}) {
            const MlsSurface surface(cloud.positions, {.degree = degree, .h = h});
            for (const double above : {0.0, 0.01, 0.1, 0.5}) {
                if (h && above > *h) continue;
                const MlsProjection p = surface.project({0.43, 0.56, above});
                EXPECT_EQ(p.status, MlsStatus::Converged) << degree << ' ' << above;
                EXPECT_NEAR((p.point - Vec3d(0.43, 0.56, 0)).norm(), 0, 1e-7) << degree;
                EXPECT_NEAR(std::abs(p.normal.z()), 1, 1e-9);
            }
        }
    }
}

/// Mean radius of the surface of a unit sphere's points.
double radius_of_sphere(const MlsOptions& options) {
    const PointCloud cloud = sphere(5000);
    const MlsSurface surface(cloud.positions, options);
    std::mt19937_64 random(7);
    double sum = 0;
    for (int i = 0; i < 500; ++i) sum += surface.project(random_direction(random)).point.norm();
    return sum / 500;
}

TEST(MlsSurface, LiesInsideASphereByHalfOfHSquaredAsAPlane) {
    for (const double h : {0.06, 0.1, 0.15}) {
        const double inside = h * h / 2;
        EXPECT_NEAR(1 - radius_of_sphere({.degree = 0, .h = h}), inside, 0.1 * inside);
        EXPECT_NEAR(1 - radius_of_sphere({.degree = 1, .h = h}), inside, 0.1 * inside);
    }
}

TEST(MlsSurface, LiesOnASphereAnOrderBetterWithDegreeTwo) {
    // What is left is of the order of h^4: sixteen times less for half of h.
    const double wide = std::abs(1 - radius_of_sphere({.degree = 2, .h = 0.2}));
    const double narrow = std::abs(1 - radius_of_sphere({.degree = 2, .h = 0.1}));
    EXPECT_LT(narrow, 0.02 * (0.1 * 0.1 / 2));
    EXPECT_NEAR(wide / narrow, 16, 5);
}

/// Of degree d, without a tilt at the origin, so that the reference plane there is z = 0.
double saddle(unsigned degree, double u, double v) {
    double z = 0;
    if (degree >= 2) z += 0.3 * u * u - 0.2 * v * v + 0.1 * u * v;
    if (degree >= 3) z += 0.4 * (u * u * u - 3 * u * v * v);
    if (degree >= 4) z += 0.2 * u * u * u * u - 0.3 * u * u * v * v;
    return z;
}

TEST(MlsSurface, ReproducesPatchesOfItsDegree) {
    const auto height_at_origin = [](unsigned patch_degree, unsigned degree) {
        const auto points =
            patch(40, [&](double u, double v) { return saddle(patch_degree, u, v); });
        const MlsSurface surface(points, {.degree = degree, .h = 0.15});
        return std::abs(surface.project({0, 0, 0}).point.z());
    };
    EXPECT_LT(height_at_origin(2, 2), 1e-7);
    EXPECT_LT(height_at_origin(3, 3), 1e-7);
    EXPECT_LT(height_at_origin(4, 4), 1e-7);
    EXPECT_GT(height_at_origin(2, 1), 1e-4);
    EXPECT_GT(height_at_origin(4, 2), 1e-6);
    EXPECT_GT(height_at_origin(4, 3), 1e-6);
}

/// Neighbours at random places of the unit disk, lifted by `height`, with weights that fall off.
MlsNeighborhood disk(std::size_t n, const std::function<double(double, double)>& height) {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> unit(-1, 1);
    MlsNeighborhood around;
    around.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
        const double u = unit(random), v = unit(random);
        around.x[i] = u;
        around.y[i] = v;
        around.z[i] = height(u, v);
        around.weight[i] = std::exp(-(u * u + v * v) / 0.25);
    }
    return around;
}

TEST(MlsPolynomial, IsExactWhereTheHeightsAreOneOfItsDegree) {
    const auto height = [](unsigned degree, double u, double v) {
        double z = 0.01;
        for (unsigned i = 0; i <= degree; ++i)
            for (unsigned j = 0; i + j <= degree; ++j)
                if (i + j > 0) z += (0.3 - 0.1 * i + 0.2 * j) * std::pow(u, i) * std::pow(v, j);
        return z;
    };
    for (unsigned degree = 1; degree <= 4; ++degree) {
        const auto around = disk(40, [&](double u, double v) { return height(degree, u, v); });
        for (unsigned fitted = degree; fitted <= 4; ++fitted) {
            const MlsHeight g = fit_polynomial(around, Vec3d::UnitZ(), Vec3d::Zero(), 0.5, fitted);
            EXPECT_NEAR(g.height, 0.01, 1e-9) << degree << ' ' << fitted;
            // d/du = 0.3 - 0.1, d/dv = 0.3 + 0.2
            EXPECT_LT((g.normal - Vec3d(-0.2, -0.5, 1).normalized()).norm(), 1e-8);
        }
    }
}

TEST(MlsPolynomial, TakesNoMoreTermsThanThereAreNeighbors) {
    const auto plane = [](double u, double v) { return 0.01 + 0.1 * u - 0.2 * v; };
    for (std::size_t n = 3; n < 20; ++n) {
        const MlsHeight g = fit_polynomial(disk(n, plane), Vec3d::UnitZ(), Vec3d::Zero(), 0.5, 4);
        EXPECT_NEAR(g.height, 0.01, 1e-6) << n;
    }
    EXPECT_EQ(fit_polynomial(disk(2, plane), Vec3d::UnitZ(), Vec3d::Zero(), 0.5, 4).height, 0);
}

TEST(MlsPolynomial, LeavesOutWhatNeighborsOnALineCannotTell) {
    MlsNeighborhood around = disk(30, [](double u, double) { return 0.02 + 0.1 * u * u; });
    std::ranges::fill(around.y, 0.0);
    for (unsigned degree = 2; degree <= 4; ++degree) {
        const MlsHeight g = fit_polynomial(around, Vec3d::UnitZ(), Vec3d::Zero(), 0.5, degree);
        EXPECT_NEAR(g.height, 0.02, 1e-6);
        EXPECT_NEAR(g.normal.z(), 1, 1e-6);
    }
}

/// Eq. 6 with the sum over p as it stands: weights by the distance from q, the projection of r = 0.
double energy(const MlsNeighborhood& around, const Vec3d& n, double t, double h) {
    double sum = 0;
    for (std::size_t i = 0; i < around.size(); ++i) {
        const Vec3d p(around.x[i], around.y[i], around.z[i]);
        const double distance = p.dot(n) - t;
        sum += distance * distance * std::exp(-(p - t * n).squaredNorm() / (h * h));
    }
    return sum;
}

TEST(MlsPlane, MinimisesEquationSixOverNormalAndOffset) {
    std::mt19937_64 random(5);
    std::normal_distribution<double> noise(0, 0.02);
    MlsNeighborhood around = disk(60, [&](double u, double v) {
        return 0.1 + 0.2 * u + 0.4 * u * u - 0.1 * u * v + noise(random);
    });
    const double h = 0.6;
    const MlsPlane plane = fit_plane(around, h, 30, 1e-9);
    ASSERT_EQ(plane.kind, MlsPlane::Kind::Minimum);
    EXPECT_LT((plane.q - plane.t * plane.n).norm(), 1e-12);
    const double least = energy(around, plane.n, plane.t, h);
    const Vec3d e1 = plane.n.unitOrthogonal(), e2 = plane.n.cross(e1);
    for (int i = 0; i < 100; ++i) {
        const Vec3d away = 1e-3 * random_direction(random);
        const Vec3d n = (plane.n + away.x() * e1 + away.y() * e2).normalized();
        EXPECT_GT(energy(around, n, plane.t + away.z(), h), least);
    }
    // Weighted least squares alone, with weights centred at r, is not that minimum.
    MlsNeighborhood once = around;
    EXPECT_NE(fit_plane(once, h, 1, 0.999).kind, MlsPlane::Kind::Line);
}

TEST(MlsSurface, SmoothsNoise) {
    const double noise = 0.02;
    const PointCloud cloud = sphere(20'000, noise);
    const MlsSurface surface(cloud.positions, {.degree = 2, .k = 64});
    std::mt19937_64 random(11);
    double sum_sq = 0;
    for (int i = 0; i < 500; ++i) {
        const MlsProjection p = surface.project(random_direction(random));
        ASSERT_TRUE(is_finite(p));
        sum_sq += std::pow(p.point.norm() - 1, 2);
    }
    // The noise has a deviation of noise / sqrt(3); about twenty neighbours count.
    EXPECT_LT(std::sqrt(sum_sq / 500), 0.5 * noise / std::sqrt(3.0));
}

TEST(MlsSurface, KeepsToTheNearerOfTwoParallelSheets) {
    PointCloud cloud = test::plane(10'000);
    PointCloud above = test::plane(10'000, 2);
    for (Vec3f& p : above.positions) p.z() = 0.1F;
    cloud.positions.insert(cloud.positions.end(), above.positions.begin(), above.positions.end());
    const MlsSurface surface(cloud.positions, {.degree = 2});
    for (const double z : {-0.03, 0.0, 0.02, 0.04})
        EXPECT_NEAR(surface.project({0.5, 0.5, z}).point.z(), 0.0, 1e-6) << z;
    for (const double z : {0.06, 0.1, 0.13})
        EXPECT_NEAR(surface.project({0.5, 0.5, z}).point.z(), 0.1, 1e-6) << z;
}

TEST(MlsSurface, IsTheFixedPointsOfItsProjection) {
    const PointCloud cloud = sphere(3000);
    const MlsSurface surface(cloud.positions, {.degree = 2, .fixed_point = true});
    std::mt19937_64 random(13);
    for (int i = 0; i < 100; ++i) {
        const MlsProjection p = surface.project(1.1 * random_direction(random));
        EXPECT_EQ(p.status, MlsStatus::Converged);
        EXPECT_LT((surface.project(p.point).point - p.point).norm(), 1e-5);
        EXPECT_GT(std::abs(p.normal.dot(p.point.normalized())), 0.999);
    }
}

TEST(MlsSurface, GivesTheNearestOfALineOrAPoint) {
    const PointCloud line = test::line(50);
    const Vec3d a = line.positions.front().cast<double>(), b = line.positions.back().cast<double>();
    const Vec3d middle = (a + b) / 2, along = (b - a).normalized();
    const Vec3d beside = middle + 0.01 * (b - a).norm() * along.unitOrthogonal();
    const MlsSurface surface(line.positions, {});
    const MlsProjection p = surface.project(beside);
    EXPECT_EQ(p.status, MlsStatus::Degenerate);
    EXPECT_LT((p.point - middle).norm(), 1e-5 * (b - a).norm());
    ASSERT_TRUE(is_finite(p));
    EXPECT_NEAR(p.normal.dot(along), 0, 1e-6);

    const std::vector<Vec3f> same(30, Vec3f(1, 2, 3));
    const MlsProjection q = MlsSurface(same, {}).project({4, 5, 6});
    EXPECT_EQ(q.status, MlsStatus::Degenerate);
    EXPECT_EQ(q.point, Vec3d(1, 2, 3));
    EXPECT_TRUE(is_finite(MlsSurface(same, {}).project({1, 2, 3})));
}

TEST(MlsSurface, IsFiniteForFewPoints) {
    const PointCloud cloud = test::cube(12);
    for (std::size_t n = 1; n <= cloud.size(); ++n) {
        for (unsigned degree = 0; degree <= 4; ++degree) {
            const MlsSurface surface(std::span(cloud.positions).first(n),
                                     {.degree = degree, .fixed_point = n % 2 == 0});
            for (const Vec3d& r : {Vec3d(0.5, 0.5, 0.5), Vec3d(100, -3, 1e6), Vec3d(0, 0, 0)})
                EXPECT_TRUE(is_finite(surface.project(r))) << n << ' ' << degree;
        }
    }
}

TEST(MlsSurface, GivesAPointBackThatNoWeightReaches) {
    const MlsSurface surface(test::plane(100).positions, {.h = 0.01});
    const MlsProjection p = surface.project({0.5, 0.5, 7});
    EXPECT_EQ(p.status, MlsStatus::TooFar);
    EXPECT_EQ(p.point, Vec3d(0.5, 0.5, 7));
}

TEST(MlsSurface, DoesNotDependOnWhereTheCloudLies) {
    const PointCloud cloud = sphere(2000);
    PointCloud moved = cloud;
    for (Vec3f& p : moved.positions) p = 1024.0F * p + Vec3f(65'536, -131'072, 0);
    const MlsSurface here(cloud.positions, {}), there(moved.positions, {});
    const Vec3d r = Vec3d(0.6, 0.1, 0.9).normalized();
    const Vec3d expected = 1024 * here.project(r).point + Vec3d(65'536, -131'072, 0);
    EXPECT_LT((there.project(1024 * r + Vec3d(65'536, -131'072, 0)).point - expected).norm(), 0.02);
}

TEST(MlsSurface, GivesTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = sphere(3000, 0.01), queries = sphere(5000, 0.1, 2);
    const MlsSurface surface(cloud.positions, {});
    const auto one = surface.project(queries.positions, {.threads = 1});
    const auto eight = surface.project(queries.positions, {.threads = 8});
    ASSERT_EQ(one.size(), queries.size());
    for (std::size_t i = 0; i < one.size(); ++i) {
        EXPECT_EQ(one[i].point, eight[i].point);
        EXPECT_EQ(one[i].point, surface.project(queries.positions[i].cast<double>()).point);
    }
}

TEST(MlsSurface, StopsWhenAsked) {
    const PointCloud cloud = sphere(1000);
    const MlsSurface surface(cloud.positions, {});
    std::stop_source source;
    source.request_stop();
    EXPECT_THROW(surface.project(cloud.positions, {.stop = source.get_token()}), Cancelled);
}

TEST(MlsSurface, RefusesWhatIsOutOfRange) {
    const PointCloud cloud = sphere(100);
    const auto message = [&](const MlsOptions& options) -> std::string {
        try {
            const MlsSurface surface(cloud.positions, options);
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ErrorCode::InvalidArgument);
            return error.what();
        }
        return "";
    };
    EXPECT_EQ(message({}), "");
    EXPECT_EQ(message({.degree = 5}), "degree 5: expected 0..4");
    EXPECT_EQ(message({.k = 5}), "k 5: expected 6..64");
    EXPECT_EQ(message({.k = 65}), "k 65: expected 6..64");
    EXPECT_EQ(message({.h = 0.0}), "h 0: expected a finite length above 0");
    EXPECT_EQ(message({.h = std::nan("")}), "h nan: expected a finite length above 0");
    EXPECT_EQ(message({.max_iterations = 0}), "max_iterations 0: expected at least 1");
    EXPECT_EQ(message({.tolerance = 0}),
              "tolerance 0: expected a fraction of h, above 0 and below 1");
    test::expect_refused("points 0: expected at least 1", [&] { MlsSurface({}, {}); });
}

TEST(MlsSurface, GivesTheSameBytesWithThePlainKernels) {
    const PointCloud cloud = sphere(3000, 0.02), places = sphere(200, 0.1);
    for (unsigned degree = 0; degree <= 4; ++degree) {
        for (const std::optional<double> h : {std::optional<double>(), std::optional(0.05)}) {
            const MlsSurface surface(cloud.positions, {.degree = degree, .k = 21, .h = h});
            const auto quick = surface.project(places.positions);
            const PlainKernelsOnly plain_only;
            const auto plain = surface.project(places.positions);
            for (std::size_t i = 0; i < quick.size(); ++i) {
                EXPECT_EQ(quick[i].point, plain[i].point);
                EXPECT_EQ(quick[i].normal, plain[i].normal);
                EXPECT_EQ(quick[i].status, plain[i].status);
            }
        }
    }
}

}  // namespace
}  // namespace stipple
