#include "stipple/synthetic_scan.hpp"

#include "stipple/cleaning.hpp"
#include "stipple/error.hpp"
#include "support/expect_error.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>

namespace stipple {
namespace {

template <typename T>
bool same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

RunContext on_threads(unsigned threads) {
    RunContext context;
    context.threads = threads;
    return context;
}

std::uint64_t fnv1a(const PointCloud& cloud) {
    std::uint64_t hash = 14695981039346656037ULL;
    const auto add = [&](const void* data, std::size_t bytes) {
        for (std::size_t i = 0; i < bytes; ++i)
            hash = (hash ^ static_cast<const unsigned char*>(data)[i]) * 1099511628211ULL;
    };
    add(cloud.positions.data(), cloud.size() * sizeof(Vec3f));
    add(cloud.normals.data(), cloud.size() * sizeof(Vec3f));
    add(cloud.colors.data(), cloud.size() * sizeof(Rgba8));
    return hash;
}

TEST(SyntheticScan, HasExactlyThePointsAskedFor) {
    for (const std::uint64_t n : {1ULL, 2ULL, 1000ULL, 12'345ULL})
        EXPECT_EQ(synthetic_scan({.points = n}).size(), n);
}

TEST(SyntheticScan, CarriesUnitNormalsColoursAndIntensity) {
    const PointCloud cloud = synthetic_scan({.points = 20'000});
    validate(cloud);
    ASSERT_EQ(cloud.normals.size(), cloud.size());
    ASSERT_EQ(cloud.colors.size(), cloud.size());
    for (const Vec3f& normal : cloud.normals) ASSERT_NEAR(normal.norm(), 1.0F, 1e-5F);

    const Attribute* intensity = find_attribute(cloud, "intensity");
    ASSERT_NE(intensity, nullptr);
    const auto& values = std::get<std::vector<float>>(intensity->values);
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    EXPECT_GE(*least, 0.0F);
    EXPECT_LE(*most, 1.0F);
    EXPECT_GT(*most - *least, 0.3F);
}

TEST(SyntheticScan, IsTheSameBytesOnOneAndManyThreads) {
    const PointCloud one = synthetic_scan({.points = 50'000, .seed = 7}, on_threads(1));
    const PointCloud many = synthetic_scan({.points = 50'000, .seed = 7}, on_threads(5));
    EXPECT_TRUE(same_bytes(one.positions, many.positions));
    EXPECT_TRUE(same_bytes(one.normals, many.normals));
    EXPECT_TRUE(same_bytes(one.colors, many.colors));
}

TEST(SyntheticScan, IsTheSameBytesOnEveryMachine) {
    EXPECT_EQ(fnv1a(synthetic_scan({.points = 10'000, .seed = 3})), 12937865946755819890ULL);
}

TEST(SyntheticScan, ChangesWithTheSeed) {
    const PointCloud a = synthetic_scan({.points = 1000, .seed = 1});
    const PointCloud b = synthetic_scan({.points = 1000, .seed = 2});
    EXPECT_FALSE(same_bytes(a.positions, b.positions));
}

TEST(SyntheticScan, NeedsNoCleaning) {
    PointCloud cloud = synthetic_scan({.points = 200'000});
    EXPECT_EQ(clean(cloud).removed(), 0U);
}

TEST(SyntheticScan, LiesWithinTheSizeThatTheHeaderNames) {
    const Aabb box = bounds(synthetic_scan({.points = 200'000, .noise = 0}));
    EXPECT_NEAR((box.max - box.min).x(), 155.0, 1.0);
    EXPECT_NEAR((box.max - box.min).y(), 181.0, 1.0);
    EXPECT_NEAR(box.min.y(), 0.0, 0.1);
}

TEST(SyntheticScan, NormalsOfThePlinthPointOutwards) {
    const PointCloud cloud = synthetic_scan({.points = 50'000, .noise = 0});
    std::size_t checked = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const Vec3f& p = cloud.positions[i];
        if (p.y() < 0.5F || p.y() > 10.5F) continue;  // the upright sides of the lowest slab
        const Vec3f outwards(std::abs(p.x()) > 61.99F ? p.x() : 0, 0,
                             std::abs(p.z()) > 42.15F ? p.z() : 0);
        ASSERT_GT(cloud.normals[i].dot(outwards), 0.0F) << p.transpose();
        ++checked;
    }
    EXPECT_GT(checked, 1000U);
}

TEST(SyntheticScan, NoiseMovesPointsAlongTheirNormalsByTheDeviationAskedFor) {
    const PointCloud still = synthetic_scan({.points = 50'000, .noise = 0});
    const PointCloud noisy = synthetic_scan({.points = 50'000, .noise = 0.5});
    double sum_sq = 0;
    for (std::size_t i = 0; i < still.size(); ++i) {
        const Vec3f moved = noisy.positions[i] - still.positions[i];
        sum_sq += std::pow(static_cast<double>(moved.dot(still.normals[i])), 2);
        ASSERT_LT(moved.cross(still.normals[i]).norm(), 1e-3F);
    }
    EXPECT_NEAR(std::sqrt(sum_sq / static_cast<double>(still.size())), 0.5, 0.01);
}

TEST(SyntheticScan, RefusesOptionsOutOfRangeByTheirValue) {
    test::expect_refused("points 0: expected 1..4294967295",
                         [&] { synthetic_scan({.points = 0}); });
    test::expect_refused("noise -1: expected 0..10 mm", [&] { synthetic_scan({.noise = -1}); });
    test::expect_refused("noise nan: expected 0..10 mm",
                         [&] { synthetic_scan({.noise = std::nan("")}); });
}

TEST(SyntheticScan, StopsWhenAskedTo) {
    std::stop_source source;
    source.request_stop();
    RunContext context;
    context.stop = source.get_token();
    EXPECT_THROW(synthetic_scan({.points = 1000}, context), Cancelled);
}

}  // namespace
}  // namespace stipple
