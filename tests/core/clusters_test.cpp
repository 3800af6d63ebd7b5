#include "stipple/clusters.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <limits>
#include <numeric>

namespace stipple {
namespace {

Clusters one_cluster(std::size_t n) {
    Clusters clusters;
    clusters.members.resize(n);
    std::iota(clusters.members.begin(), clusters.members.end(), Index{0});
    clusters.offsets = {0, static_cast<Index>(n)};
    return clusters;
}

/// A patch of the unit sphere around its pole.
PointCloud cap(double height) {
    PointCloud all = test::sphere(40'000), result;
    for (const Vec3f& p : all.positions) {
        if (static_cast<double>(p.z()) > 1.0 - height) result.positions.push_back(p);
    }
    return result;
}

Vec3f representative(const PointCloud& cloud, Representative kind) {
    return representatives(cloud, one_cluster(cloud.size()), kind).positions.front();
}

TEST(Representatives, OfACapTheCentroidLiesInside) {
    const PointCloud patch = cap(0.05);
    EXPECT_LT(representative(patch, Representative::Centroid).norm(), 0.98F);
}

TEST(Representatives, OfACapTheSurfacePointLiesOnTheSphere) {
    const PointCloud patch = cap(0.05);
    const Vec3f centroid = representative(patch, Representative::Centroid);
    const Vec3f surface = representative(patch, Representative::Surface);
    // The quadratic leaves what is of fourth order: less than a fiftieth of the shrinkage.
    EXPECT_LT(std::abs(surface.norm() - 1.0F), (1.0F - centroid.norm()) / 50.0F);
}

TEST(Representatives, TheSurfacePointLiesOnAParaboloidOfTwoCurvaturesWhereverItStands) {
    PointCloud cloud;
    for (int u = -10; u <= 10; ++u) {
        for (int v = -5; v <= 5; ++v) {
            const float x = 0.1F * static_cast<float>(u), y = 0.1F * static_cast<float>(v);
            cloud.positions.emplace_back(1000.0F + 1e-3F * x, -500.0F + 1e-3F * y,
                                         1e-3F * (0.3F * x * x - 0.2F * y * y));
        }
    }
    const Vec3f surface = representative(cloud, Representative::Surface);
    EXPECT_NEAR(surface.z(), 0.0F, 2e-6F);
}

TEST(Representatives, OfNoiseTheSurfacePointStaysAmongTheSamples) {
    PointCloud cloud = test::cube(20);
    const Vec3f surface = representative(cloud, Representative::Surface);
    EXPECT_TRUE((surface.array() >= 0).all() && (surface.array() <= 1).all());
}

TEST(Representatives, TheNearestIsTheInputPointWithAllItsAttributes) {
    const PointCloud cloud = test::with_attributes(cap(0.2));
    const PointCloud result =
        representatives(cloud, one_cluster(cloud.size()), Representative::Nearest);
    const auto found = std::ranges::find(cloud.positions, result.positions.front());
    ASSERT_NE(found, cloud.positions.end());
    const auto i = static_cast<std::size_t>(found - cloud.positions.begin());
    EXPECT_EQ(result.colors.front(), cloud.colors[i]);
    EXPECT_EQ(result.normals.front(), cloud.normals[i]);
    EXPECT_EQ(std::get<std::vector<float>>(result.attributes[0].values).front(),
              std::get<std::vector<float>>(cloud.attributes[0].values)[i]);
}

PointCloud three_points() {
    PointCloud cloud;
    cloud.positions = {{0, 0, 0}, {1, 0, 0}, {0.4F, 0.1F, 0}};
    return cloud;
}

TEST(Reductions, AverageColoursInLinearLight) {
    PointCloud cloud;
    cloud.positions = {{0, 0, 0}, {1, 0, 0}};
    cloud.colors = {{0, 0, 0, 255}, {255, 255, 255, 255}};
    const PointCloud result = representatives(cloud, one_cluster(2), Representative::Centroid);
    EXPECT_EQ(result.colors.front(), (Rgba8{188, 188, 188, 255}));  // half of the light of white
}

TEST(Reductions, WeighColoursByAlphaWhereTheyHaveOne) {
    PointCloud cloud = three_points();
    cloud.colors = {{255, 0, 0, 0}, {0, 0, 255, 255}, {255, 255, 255, 0}};
    const auto mean = [](const PointCloud& of) {
        return representatives(of, one_cluster(3), Representative::Centroid).colors.front();
    };
    EXPECT_EQ(mean(cloud), (Rgba8{213, 156, 213, 85})) << "alpha means nothing here";
    cloud.has_alpha = true;
    EXPECT_EQ(mean(cloud), (Rgba8{0, 0, 255, 85})) << "only the second point is to be seen";
    cloud.colors = {{255, 255, 255, 50}, {0, 0, 0, 150}, {9, 9, 9, 0}};
    EXPECT_EQ(mean(cloud), (Rgba8{137, 137, 137, 67})) << "a quarter of the light of white";
    cloud.colors = {{80, 90, 100, 0}, {80, 90, 100, 0}, {80, 90, 100, 0}};
    EXPECT_EQ(mean(cloud), (Rgba8{80, 90, 100, 0})) << "none is to be seen";
}

TEST(Reductions, KeepEveryColourOfAUniformCluster) {
    for (int code = 0; code < 256; ++code) {
        PointCloud cloud = three_points();
        const auto c = static_cast<std::uint8_t>(code);
        cloud.colors.assign(3, {c, c, c, c});
        for (const bool has_alpha : {false, true}) {
            cloud.has_alpha = has_alpha;
            const PointCloud result =
                representatives(cloud, one_cluster(3), Representative::Centroid);
            ASSERT_EQ(result.colors.front(), cloud.colors.front());
        }
    }
}

TEST(Reductions, RenormaliseNormals) {
    PointCloud cloud = three_points();
    cloud.normals = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    const Vec3f normal =
        representatives(cloud, one_cluster(3), Representative::Centroid).normals.front();
    EXPECT_NEAR(normal.norm(), 1.0F, 1e-6F);
    EXPECT_NEAR(normal.x(), std::sqrt(1.0F / 3.0F), 1e-6F);
}

TEST(Reductions, WeighNormalsOfAnyLengthAlike) {
    PointCloud cloud = three_points();
    cloud.normals = {{100, 0, 0}, {0, 0.01F, 0}, {0, 0, 0}};
    const Vec3f normal =
        representatives(cloud, one_cluster(3), Representative::Centroid).normals.front();
    EXPECT_NEAR(normal.x(), std::sqrt(0.5F), 1e-6F);
    EXPECT_NEAR(normal.y(), std::sqrt(0.5F), 1e-6F);
}

TEST(Reductions, TakeTheNearestNormalWhereNormalsCancel) {
    PointCloud cloud;
    cloud.positions = {{0, 0, 0}, {1, 0, 0}};
    cloud.normals = {{0, 0, 1}, {0, 0, -1}};
    const Vec3f normal =
        representatives(cloud, one_cluster(2), Representative::Centroid).normals.front();
    EXPECT_EQ(normal, Vec3f(0, 0, 1));
}

TEST(Reductions, FollowThePolicyOfEachAttribute) {
    PointCloud cloud = three_points();
    const std::vector<std::int32_t> values = {5, 1, 5};
    for (const auto& [name, reduction] : {std::pair{"mean", Reduction::Mean},
                                          {"nearest", Reduction::Nearest},
                                          {"min", Reduction::Min},
                                          {"max", Reduction::Max},
                                          {"mode", Reduction::Mode}}) {
        cloud.attributes.push_back({name, values, 1, reduction});
    }
    cloud.attributes.push_back(
        {"pair", std::vector<float>{1, 10, 2, 20, 3, 30}, 2, Reduction::Mean});
    const PointCloud result = representatives(cloud, one_cluster(3), Representative::Centroid);
    const auto value = [&](std::size_t a) {
        return std::get<std::vector<std::int32_t>>(result.attributes[a].values).front();
    };
    EXPECT_EQ(value(0), 4);  // 11 / 3 rounded
    EXPECT_EQ(value(1), 5);  // of the third point
    EXPECT_EQ(value(2), 1);
    EXPECT_EQ(value(3), 5);
    EXPECT_EQ(value(4), 5);
    EXPECT_EQ(std::get<std::vector<float>>(result.attributes[5].values),
              (std::vector<float>{2, 20}));
}

TEST(Reductions, ChooseAmongWhatIsANumber) {
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
    PointCloud cloud;
    for (int i = 0; i < 5; ++i) cloud.positions.emplace_back(static_cast<float>(i), 0, 0);
    const std::vector<float> values = {kNan, 0, 5, kNan, 5};
    for (const Reduction reduction : {Reduction::Min, Reduction::Max, Reduction::Mode})
        cloud.attributes.push_back({"some", values, 1, reduction});
    cloud.attributes.push_back({"none", std::vector<float>(5, kNan), 1, Reduction::Mode});
    cloud.attributes.push_back({"mean", values, 1, Reduction::Mean});
    cloud.attributes.push_back({"no mean", std::vector<float>(5, kNan), 1, Reduction::Mean});
    cloud.attributes.push_back({"large", std::vector<double>(5, 1e308), 1, Reduction::Mean});
    const PointCloud result = representatives(cloud, one_cluster(5), Representative::Centroid);
    const auto value = [&](std::size_t a) {
        return std::get<std::vector<float>>(result.attributes[a].values).front();
    };
    EXPECT_EQ(value(0), 0);
    EXPECT_EQ(value(1), 5);
    EXPECT_EQ(value(2), 5);
    EXPECT_TRUE(std::isnan(value(3)));
    EXPECT_EQ(value(4), 10.0F / 3);
    EXPECT_TRUE(std::isnan(value(5)));
    EXPECT_EQ(std::get<std::vector<double>>(result.attributes[6].values).front(), 1e308);
}

}  // namespace
}  // namespace stipple
