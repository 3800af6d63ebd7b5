#include "stipple/multiphase.hpp"

#include "contraction/multiphase_runs.hpp"
#include "stipple/hierarchical_clustering.hpp"
#include "stipple/mls.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <set>

namespace stipple {
namespace {

MultiphaseOptions to(std::uint64_t size) {
    MultiphaseOptions options;
    options.contraction.target_size = size;
    return options;
}

bool is_finite(const PointCloud& cloud) {
    return std::ranges::all_of(cloud.positions, [](const Vec3f& p) { return p.allFinite(); });
}

/// A cube's surface, n x n points a face.
PointCloud box(int n) {
    std::set<std::array<int, 3>> places;
    for (int u = 0; u <= n; ++u) {
        for (int v = 0; v <= n; ++v) {
            for (const int end : {0, n}) {
                places.insert({u, v, end});
                places.insert({u, end, v});
                places.insert({end, u, v});
            }
        }
    }
    PointCloud cloud;
    for (const auto& [x, y, z] : places) {
        cloud.positions.push_back(
            Vec3f(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)) /
            static_cast<float>(n));
    }
    return cloud;
}

/// Mean distance from the unit sphere.
double mean_height(const PointCloud& cloud) {
    double sum = 0;
    for (const Vec3f& p : cloud.positions) sum += static_cast<double>(p.norm()) - 1.0;
    return sum / static_cast<double>(cloud.size());
}

TEST(Multiphase, GivesEveryCountFromOneToAll) {
    const PointCloud cloud = test::sphere(200, 0.1);
    for (std::uint64_t n = 1; n <= 200; ++n) {
        const PointCloud result = multiphase(cloud, to(n));
        EXPECT_EQ(result.size(), n);
        EXPECT_TRUE(is_finite(result));
    }
}

TEST(Multiphase, GivesExactlyTheCountForEveryOversampling) {
    const PointCloud cloud = test::sphere(5000, 0.01);
    for (const double m : {1.0, 1.5, 3.0, 8.0, 1000.0}) {
        MultiphaseOptions options = to(321);
        options.oversampling = m;
        EXPECT_EQ(multiphase(cloud, options).size(), 321U);
    }
}

TEST(Multiphase, OfASphereDoesNotShrinkIt) {
    const double height = mean_height(multiphase(test::sphere(40'000), to(500)));
    // The linear surface through the points lies h^2 / 2 inside of them, the quadratic one does
    // not.
    const double h_sq = 20 * 4.0 / 500 / 9;
    EXPECT_GT(height, 0);
    EXPECT_LT(height, h_sq / 4);
}

TEST(Multiphase, FitsASphereBetterWhereFewPointsAreLeftOfMany) {
    const auto distance_of_surface = [](std::size_t points) {
        const PointCloud left = multiphase(test::sphere(points), to(300));
        const MlsSurface surface(left.positions, {.degree = 2, .fixed_point = true});
        double sum = 0;
        for (const Vec3f& p : test::sphere(2000).positions)
            sum += std::abs(surface.project(p.cast<double>()).point.norm() - 1);
        return sum / 2000;
    };
    EXPECT_LT(distance_of_surface(50 * 300), 0.8 * distance_of_surface(49 * 300));
}

TEST(Multiphase, AveragesNoise) {
    const auto roughness = [](const PointCloud& cloud) {
        double sum = 0;
        for (const Vec3f& p : cloud.positions) {
            const double height = static_cast<double>(p.norm()) - 1.0;
            sum += height * height;
        }
        return std::sqrt(sum / static_cast<double>(cloud.size()));
    };
    const PointCloud cloud = test::sphere(40'000, 0.03);
    EXPECT_LT(roughness(multiphase(cloud, to(800))), 0.37 * roughness(cloud));
}

TEST(Multiphase, KeepsPointsOnTheEdgesOfABox) {
    // What lies within a spacing of an edge is on it; clusters alone round it off.
    const PointCloud result = multiphase(box(60), to(600));
    int near = 0, on = 0;
    for (const Vec3f& p : result.positions) {
        std::array<float, 3> depth;
        for (int axis = 0; axis < 3; ++axis) {
            depth[static_cast<std::size_t>(axis)] = std::abs(std::min(p[axis], 1.0F - p[axis]));
        }
        std::ranges::sort(depth);
        if (depth[1] > 0.03F) continue;
        ++near;
        if (depth[1] < 0.01F) ++on;
    }
    EXPECT_GT(near, 50);
    EXPECT_GT(on, 3 * near / 5);
}

TEST(Multiphase, PutsMorePointsWhereTheSurfaceBends) {
    PointCloud cloud = test::plane(20'000);
    for (Vec3f& p : cloud.positions)
        if (p.x() > 0.5F) p.z() = 0.05F * std::sin(25.0F * p.x()) * std::sin(25.0F * p.y());
    const PointCloud result = multiphase(cloud, to(400));
    const auto bent =
        std::ranges::count_if(result.positions, [](const Vec3f& p) { return p.x() > 0.5F; });
    EXPECT_GT(bent, 250);
    EXPECT_LT(bent, 390);  // flat parts stay covered
}

TEST(Multiphase, PointsOfAPlaneStayOnItAndWithinIt) {
    for (const Vec3f& p : multiphase(test::plane(10'000), to(300)).positions) {
        EXPECT_NEAR(p.z(), 0.0F, 1e-6F);
        EXPECT_TRUE(p.x() >= 0 && p.x() <= 1 && p.y() >= 0 && p.y() <= 1);
    }
}

TEST(Multiphase, PointsOfALineStayOnItAndWithinIt) {
    const PointCloud line = test::line(1000);
    const Vec3f from = line.positions.front(), along = line.positions.back() - from;
    for (const std::uint64_t size : {1U, 2U, 10U, 300U}) {
        for (const Vec3f& p : multiphase(line, to(size)).positions) {
            const float at = (p - from).dot(along) / along.squaredNorm();
            EXPECT_LT((p - from - at * along).norm(), 1e-5F * along.norm());
            EXPECT_TRUE(at >= 0 && at <= 1) << at;
        }
    }
}

TEST(Multiphase, WorksAtAnyScaleAndFarFromTheOrigin) {
    const PointCloud cloud = test::sphere(3000, 0.01);
    const PointCloud reference = multiphase(cloud, to(100));
    for (const float scale : {0x1p-40F, 0x1p40F}) {
        PointCloud scaled = cloud;
        for (Vec3f& p : scaled.positions) p *= scale;
        const PointCloud result = multiphase(scaled, to(100));
        for (std::size_t i = 0; i < result.size(); ++i)
            EXPECT_EQ(result.positions[i], reference.positions[i] * scale);
    }
    PointCloud far = cloud;
    for (Vec3f& p : far.positions) p += Vec3f(1e4F, -1e4F, 1e4F);
    for (const Vec3f& p : multiphase(far, to(100)).positions)
        EXPECT_NEAR((p - Vec3f(1e4F, -1e4F, 1e4F)).norm(), 1.0F, 0.05F);
}

TEST(Multiphase, IsTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::with_attributes(test::sphere(60'000, 0.02));
    const PointCloud one = multiphase(cloud, to(5000), {.threads = 1});
    const PointCloud eight = multiphase(cloud, to(5000), {.threads = 8});
    EXPECT_EQ(one.positions, eight.positions);
    EXPECT_EQ(one.normals, eight.normals);
    EXPECT_EQ(one.colors, eight.colors);
    EXPECT_EQ(one.attributes[0].values, eight.attributes[0].values);
}

TEST(Multiphase, ReducesAttributesByTheirPolicy) {
    const PointCloud cloud = test::with_attributes(test::sphere(3000));
    const PointCloud result = multiphase(cloud, to(1));
    ASSERT_EQ(result.attributes.size(), cloud.attributes.size());
    const auto& values = std::get<std::vector<float>>(cloud.attributes[0].values);
    double mean = 0;
    for (const float v : values)
        mean += static_cast<double>(v) / static_cast<double>(values.size());
    EXPECT_NEAR(std::get<std::vector<float>>(result.attributes[0].values)[0], mean, 1e-4);
    EXPECT_EQ(result.colors.size(), 1U);
    EXPECT_NEAR(multiphase(cloud, to(77)).normals[5].norm(), 1.0F, 1e-5F);
}

TEST(Multiphase, WithEndPointsGivesInputPointsWithAllTheirAttributes) {
    const PointCloud cloud = test::with_attributes(test::sphere(3000, 0.05));
    MultiphaseOptions options = to(200);
    options.contraction.placement = Placement::EndPoint;
    const PointCloud result = multiphase(cloud, options);
    ASSERT_EQ(result.size(), 200U);
    for (std::size_t i = 0; i < result.size(); ++i) {
        const auto found = std::ranges::find(cloud.positions, result.positions[i]);
        ASSERT_NE(found, cloud.positions.end());
        EXPECT_EQ(result.colors[i],
                  cloud.colors[static_cast<std::size_t>(found - cloud.positions.begin())]);
    }
}

TEST(Multiphase, KeepsPointsWithinTheBoundOfDisplacement) {
    const PointCloud cloud = test::sphere(5000);
    MultiphaseOptions options = to(150);
    options.contraction.max_displacement = 0.0;
    for (const Vec3f& p : multiphase(cloud, options).positions) EXPECT_NEAR(p.norm(), 1.0F, 1e-3F);
}

TEST(Multiphase, PutsMorePointsWhereWeighedColorsChange) {
    PointCloud cloud = test::plane(20'000);
    for (const Vec3f& p : cloud.positions)
        cloud.colors.push_back(p.x() < 0.5F ? Rgba8{255, 0, 0} : Rgba8{0, 0, 255});
    const auto near_the_edge = [&](double weight) {
        MultiphaseOptions options = to(400);
        options.contraction.color_weight = weight;
        return std::ranges::count_if(multiphase(cloud, options).positions,
                                     [](const Vec3f& p) { return std::abs(p.x() - 0.5F) < 0.05F; });
    };
    EXPECT_LT(near_the_edge(0), 60);
    EXPECT_GT(near_the_edge(0.1), 80);
}

TEST(MultiphaseSnapshots, OfTheLargestSizeIsWhatMultiphaseGives) {
    const PointCloud cloud = test::with_attributes(test::sphere(5000, 0.02));
    const std::vector<std::uint64_t> sizes = {20, 5000, 400, 100};
    std::vector<PointCloud> clouds;
    multiphase_snapshots(cloud, sizes, {}, [&](PointCloud&& c) { clouds.push_back(std::move(c)); });
    ASSERT_EQ(clouds.size(), sizes.size());
    for (std::size_t i = 0; i < sizes.size(); ++i) EXPECT_EQ(clouds[i].size(), sizes[i]);
    EXPECT_EQ(clouds[1].positions, cloud.positions);
    EXPECT_EQ(clouds[2].positions, multiphase(cloud, to(400)).positions);
    EXPECT_EQ(clouds[2].colors, multiphase(cloud, to(400)).colors);
}

TEST(MultiphaseRuns, EachIsWhatMultiphaseGives) {
    const PointCloud cloud = test::with_attributes(test::sphere(5000, 0.02));
    const std::vector<std::uint64_t> sizes = {20, 5000, 4000, 100};
    const MultiphaseRuns runs(cloud, sizes, {}, {});
    for (const std::uint64_t size : sizes) {
        const PointCloud run = runs.run(size, {}), alone = multiphase(cloud, to(size));
        ASSERT_EQ(run.size(), alone.size());
        EXPECT_EQ(run.colors, alone.colors) << size;
        // A tree that has grown further lists a cluster's points in another order: sums round
        // otherwise.
        for (std::size_t i = 0; i < run.size(); ++i)
            EXPECT_LT((run.positions[i] - alone.positions[i]).norm(), 1e-5F) << size;
    }
}

TEST(Multiphase, RefusesOptionsOutOfRange) {
    const PointCloud cloud = test::cube(100);
    test::expect_refused("target_size 0: expected at least 1", [&] { multiphase(cloud, to(0)); });
    test::expect_refused("the cloud has no points", [&] { multiphase({}, to(5)); });
    for (const double m : {0.5, 1001.0, std::nan("")}) {
        MultiphaseOptions options = to(5);
        options.oversampling = m;
        test::expect_refused(": expected 1 to 1000", [&] { multiphase(cloud, options); });
    }
    MultiphaseOptions options = to(5);
    options.contraction.k = 2;
    test::expect_refused("k 2: expected 3..32", [&] { multiphase(cloud, options); });
    options = to(5);
    options.contraction.reductions["nothing"] = Reduction::Max;
    test::expect_refused("reductions: no attribute nothing", [&] { multiphase(cloud, options); });
}

}  // namespace
}  // namespace stipple
