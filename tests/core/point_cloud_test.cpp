#include "stipple/point_cloud.hpp"

#include "cloud/attribute_name.hpp"
#include "stipple/error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <vector>

namespace stipple {
namespace {

TEST(PointCloud, ValidateNamesTheArrayThatDoesNotFit) {
    PointCloud cloud = test::with_attributes(test::cube(10));
    EXPECT_NO_THROW(validate(cloud));
    std::get<std::vector<float>>(cloud.attributes[0].values).pop_back();
    try {
        validate(cloud);
        FAIL() << "expected an error";
    } catch (const Error& error) {
        EXPECT_STREQ(error.what(), "attribute height: 9 values for 10 points of 1");
    }
}

TEST(PointCloud, HasAFiniteOrigin) {
    PointCloud cloud = test::cube(10);
    cloud.origin.y() = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(validate(cloud), Error);
}

TEST(PointCloud, BoundsAddTheOriginAndLeaveOutWhatIsNotFinite) {
    PointCloud cloud;
    cloud.origin = {1e6, 0, 0};
    cloud.positions = {{0, 1, 2}, {3, -1, 0}, {std::nanf(""), 9, 9}};
    const Aabb box = bounds(cloud);
    EXPECT_EQ(box.min, Vec3d(1e6, -1, 0));
    EXPECT_EQ(box.max, Vec3d(1e6 + 3, 1, 2));
    EXPECT_TRUE(bounds({}).empty());
    EXPECT_EQ(bounds({}).diagonal(), 0.0);
}

TEST(PointCloud, TheMiddleOfMostIsNotMovedByStrays) {
    PointCloud cloud = test::sphere(5'000);
    cloud.origin = {1e6, 0, 0};
    for (int i = 0; i < 20; ++i) cloud.positions.emplace_back(1e5F, -1e7F, 3.0F);
    EXPECT_LT((middle_of_most(cloud) - cloud.origin).norm(), 0.1);
    EXPECT_EQ(middle_of_most({}), Vec3d(0, 0, 0));
}

TEST(PointCloud, ASubsetHasAllAttributesInTheOrderAsked) {
    PointCloud cloud = test::with_attributes(test::cube(10));
    cloud.origin = {1, 2, 3};
    cloud.attributes.push_back({"pair", std::vector<std::uint8_t>(20, 1), 2, Reduction::Nearest});
    const std::vector<Index> chosen = {7, 0, 7};
    const PointCloud result = subset(cloud, chosen);
    EXPECT_NO_THROW(validate(result));
    EXPECT_EQ(result.origin, cloud.origin);
    for (std::size_t i = 0; i < chosen.size(); ++i) {
        EXPECT_EQ(result.positions[i], cloud.positions[chosen[i]]);
        EXPECT_EQ(result.colors[i], cloud.colors[chosen[i]]);
    }
}

TEST(PointCloud, FloatsAreAveragedAndIntegersAreNotUnlessToldTo) {
    EXPECT_EQ(default_reduction(std::vector<float>{}), Reduction::Mean);
    EXPECT_EQ(default_reduction(std::vector<double>{}), Reduction::Mean);
    EXPECT_EQ(default_reduction(std::vector<std::uint16_t>{}), Reduction::Nearest);
}

TEST(PointCloud, ATimeIsThatOfAPoint) {
    for (const char* const name : {"gps_time", "GpsTime", "scalar_Gps_Time"})
        EXPECT_EQ(reduction_of(name, std::vector<double>{0.5}), Reduction::Nearest) << name;
    for (const char* const name : {"intensity", "gps_time_2", "time"})
        EXPECT_EQ(reduction_of(name, std::vector<double>{0.5}), Reduction::Mean) << name;
}

}  // namespace
}  // namespace stipple
