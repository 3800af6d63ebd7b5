#include "stipple/surface_attributes.hpp"

#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <string_view>

namespace stipple {
namespace {

const std::vector<float>& scalars(const PointCloud& cloud, std::string_view name) {
    const Attribute* attribute = find_attribute(cloud, name);
    if (attribute == nullptr) throw Error(ErrorCode::Internal, "no " + std::string(name));
    return std::get<std::vector<float>>(attribute->values);
}

TEST(SurfaceAttributes, OfASphereAreItsNormalsOutward) {
    PointCloud cloud = test::sphere(4000);
    EXPECT_TRUE(add_surface_attributes(cloud).empty());
    EXPECT_NO_THROW(validate(cloud));
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        EXPECT_GT(cloud.normals[i].dot(cloud.positions[i].normalized()), 0.97F);
        EXPECT_LT(scalars(cloud, "variation")[i], 0.02F);
    }
}

TEST(SurfaceAttributes, OfAPlaneHaveItsDensity) {
    PointCloud cloud = test::plane(10'000);
    add_surface_attributes(cloud, {.signs = NormalSigns::Any});
    double mean = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        EXPECT_NEAR(std::abs(cloud.normals[i].z()), 1.0F, 1e-4F);
        EXPECT_NEAR(scalars(cloud, "variation")[i], 0.0F, 1e-6F);
        EXPECT_GE(scalars(cloud, "anisotropy")[i], 0.0F);
        mean += scalars(cloud, "density")[i] / 1e4;
    }
    // k points in the disc of radius r: 10,000 on a unit area are k / (pi r^2), so k / r^2 is pi
    // times as much. The radius of the k-th neighbour varies, and the border lacks a half.
    EXPECT_NEAR(mean / (10'000 * M_PI), 1.0, 0.15);
}

TEST(SurfaceAttributes, OfScanLinesHaveTheNormalsOfTheSurfaceBetweenThem) {
    // Fifteen times as dense along the lines as across them: 16 neighbours are all on one.
    PointCloud cloud;
    const std::vector<Vec3f> noise = test::cube(12'000).positions;
    for (int line = 0; line < 20; ++line) {
        for (int i = 0; i < 600; ++i) {
            const Vec3f place(static_cast<float>(line) / 40, static_cast<float>(i) / 600, 0);
            cloud.positions.push_back(place + 5e-4F * noise[cloud.size()]);
        }
    }
    add_surface_attributes(cloud, {.signs = NormalSigns::Any});
    double mean = 0;
    for (const Vec3f& normal : cloud.normals) mean += std::abs(normal.z()) / 12'000;
    EXPECT_GT(mean, 0.999);
}

TEST(SurfaceAttributes, TurnTowardsAViewpoint) {
    PointCloud cloud = test::sphere(2000);
    add_surface_attributes(cloud, {.signs = NormalSigns::Viewpoint, .viewpoint = Vec3d::Zero()});
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        EXPECT_LT(cloud.normals[i].dot(cloud.positions[i]), 0);
    }
}

TEST(SurfaceAttributes, StandInThePlaceOfThoseThatWereThere) {
    PointCloud cloud = test::plane(500);
    cloud.normals.assign(cloud.size(), Vec3f::UnitX());
    cloud.attributes.push_back({"density", std::vector<std::uint8_t>(cloud.size(), 7)});
    cloud.attributes.push_back({"label", std::vector<std::uint8_t>(cloud.size(), 7)});
    add_surface_attributes(cloud);
    EXPECT_EQ(cloud.attributes.size(), 4U);
    EXPECT_GT(scalars(cloud, "density")[0], 8.0F);
    EXPECT_NE(find_attribute(cloud, "label"), nullptr);
    EXPECT_NEAR(std::abs(cloud.normals[0].z()), 1.0F, 1e-4F);
}

TEST(SurfaceAttributes, LeaveAnAttributeThatIsNamedAsANormalItsValues) {
    for (const bool splats : {false, true}) {
        PointCloud cloud = test::plane(500);
        cloud.normals.clear();
        cloud.attributes.push_back({"nx", std::vector<std::uint8_t>(cloud.size(), 7)});
        if (splats)
            add_splats(cloud, SplatAttributes::Normal);
        else
            add_surface_attributes(cloud);
        const PointCloud read = decode_cloud(encode_ply(cloud));
        EXPECT_EQ(read.normals.size(), cloud.size());
        ASSERT_NE(find_attribute(read, "nx_2"), nullptr);
        EXPECT_EQ(find_attribute(read, "nx_2")->values, cloud.attributes[0].values);
    }
}

TEST(SurfaceAttributes, WithFeatureLinesHaveTheNumberOfEachPointsLine) {
    // Two roofs far apart, with a crease each.
    PointCloud roofs;
    for (int r = 0; r < 2; ++r) {
        for (int i = 0; i < 41; ++i) {
            for (int j = 0; j < 41; ++j) {
                const float x = static_cast<float>(i) / 40.0F;
                roofs.positions.emplace_back(x, static_cast<float>(j) / 40.0F,
                                             std::abs(x - 0.5F) + static_cast<float>(10 * r));
            }
        }
    }
    const PointCloud lines = add_surface_attributes(roofs, {.feature_lines = FeatureLineOptions{}});
    EXPECT_EQ(scalars(roofs, "feature_weight").size(), roofs.size());
    EXPECT_EQ(scalars(lines, "feature_weight").size(), lines.size());
    const auto& numbers =
        std::get<std::vector<std::uint32_t>>(find_attribute(lines, "line")->values);
    ASSERT_GT(lines.size(), 10U);
    EXPECT_TRUE(std::ranges::is_sorted(numbers));
    EXPECT_GE(numbers.back(), 1U);
    for (std::size_t i = 1; i < lines.size(); ++i) {
        if (numbers[i] != numbers[i - 1]) continue;
        EXPECT_LT((lines.positions[i] - lines.positions[i - 1]).norm(), 0.3F);  // links are short
    }
}

TEST(SurfaceAttributes, RefuseOptionsOutOfRangeAndNoPoints) {
    PointCloud cloud = test::plane(100);
    const auto refuses = [&](const SurfaceAttributeOptions& options, std::string_view part) {
        test::expect_refused(part, [&] { add_surface_attributes(cloud, options); });
    };
    refuses({.k = 2}, "k 2: expected 3..64, or 0 to choose");
    refuses({.k = 65}, "k 65: expected 3..64, or 0 to choose");
    refuses({.signs = NormalSigns::Viewpoint}, "viewpoint: missing");
    refuses({.viewpoint = Vec3d::Zero()}, "viewpoint: expected only if");
    refuses({.signs = NormalSigns::Viewpoint, .viewpoint = Vec3d::Constant(NAN)},
            "viewpoint: expected finite coordinates");
    refuses({.feature_lines = FeatureLineOptions{.variation = 0}}, "feature_lines.variation");
    refuses({.feature_lines = FeatureLineOptions{.high = 0.3}}, "0 < low <= high <= 1");
    refuses({.feature_lines = FeatureLineOptions{.min_links = 1}}, "feature_lines.min_links");
    PointCloud empty;
    test::expect_refused("the cloud has no points", [&] { add_surface_attributes(empty); });
}

TEST(SplatAttributesOf, APlaneCoverItAndLieInIt) {
    PointCloud cloud = test::plane(2000);
    add_splats(cloud, SplatAttributes::Ellipse);
    EXPECT_NO_THROW(validate(cloud));
    const auto& radius = scalars(cloud, "radius");
    const auto& major = scalars(cloud, "major");
    const auto& minor = scalars(cloud, "minor");
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        EXPECT_GT(radius[i], 0.0F);
        EXPECT_NEAR(std::abs(cloud.normals[i].z()), 1.0F, 1e-4F);
        const Vec3f a(major[3 * i], major[3 * i + 1], major[3 * i + 2]);
        const Vec3f b(minor[3 * i], minor[3 * i + 1], minor[3 * i + 2]);
        EXPECT_NEAR(a.z(), 0.0F, 1e-5F);
        EXPECT_NEAR(a.dot(b), 0.0F, 1e-5F);
        EXPECT_GE(a.norm(), b.norm() * (1 - 1e-5F));
    }
}

TEST(SplatAttributesOf, ACloudWithNormalsKeepThem) {
    PointCloud cloud = test::plane(100);
    cloud.normals.assign(cloud.size(), Vec3f::UnitX());
    add_splats(cloud, SplatAttributes::Normal);
    EXPECT_EQ(cloud.normals[0], Vec3f::UnitX());
    EXPECT_EQ(cloud.attributes.size(), 1U);
    add_splats(cloud, SplatAttributes::Radius);
    EXPECT_EQ(cloud.attributes.size(), 1U);  // measured anew, in the same place
}

TEST(SplatAttributesOf, NoneAreNone) {
    PointCloud cloud = test::plane(100);
    add_splats(cloud, SplatAttributes::None);
    EXPECT_TRUE(cloud.attributes.empty());
}

}  // namespace
}  // namespace stipple
