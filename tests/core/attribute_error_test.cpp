#include "base/random.hpp"
#include "cloud/color_difference.hpp"
#include "stipple/surface_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

namespace stipple {
namespace {

TEST(Ciede2000, HasTheValuesOfItsTestData) {
    // Sharma, Wu, Dalal 2005, table 1: pairs 1, 4, 7, 10, 13, 17, 20, 25, 28, 31, 34.
    struct Pair {
        Vec3d a, b;
        double difference;
    };
    const Pair pairs[] = {
        {{50, 2.6772, -79.7751}, {50, 0, -82.7485}, 2.0425},
        {{50, -1.3802, -84.2814}, {50, 0, -82.7485}, 1.0000},
        {{50, 0, 0}, {50, -1, 2}, 2.3669},
        {{50, 2.4900, -0.0010}, {50, -2.4900, 0.0010}, 7.1792},
        {{50, -0.0010, 2.4900}, {50, 0.0009, -2.4900}, 4.8045},
        {{50, 2.5, 0}, {73, 25, -18}, 27.1492},
        {{50, 2.5, 0}, {58, 24, 15}, 19.4535},
        {{60.2574, -34.0099, 36.2677}, {60.4626, -34.1751, 39.4387}, 1.2644},
        {{35.0831, -44.1164, 3.7933}, {35.0232, -40.0716, 1.5901}, 1.8645},
        {{36.4612, 47.8580, 18.3852}, {36.2715, 50.5065, 21.2231}, 1.4146},
        {{2.0776, 0.0795, -1.1350}, {0.9033, -0.0636, -0.5514}, 0.9082},
    };
    for (const Pair& pair : pairs) {
        EXPECT_NEAR(ciede2000(pair.a, pair.b), pair.difference, 1e-4);
        EXPECT_NEAR(ciede2000(pair.b, pair.a), pair.difference, 1e-4);
        EXPECT_EQ(ciede2000(pair.a, pair.a), 0);
    }
    EXPECT_NEAR(lab_from_linear({1, 1, 1}).x(), 100, 1e-9);
    EXPECT_NEAR(ciede2000(lab_from_linear({1, 1, 1}), lab_from_linear({0, 0, 0})), 100, 1e-6);
}

const AttributeError& attribute(const DirectedError& error, const std::string& name) {
    const auto found = std::ranges::find(error.attributes, name, &AttributeError::name);
    if (found == error.attributes.end()) throw std::runtime_error("no attribute " + name);
    return *found;
}

TEST(AttributeErrors, AreKnownForKnownDifferences) {
    PointCloud a = test::plane(3000), b = test::plane(1000, 2);
    const auto dress = [](PointCloud& cloud, const Rgba8& color, const Vec3f& normal, float offset,
                          std::uint8_t label) {
        cloud.colors.assign(cloud.size(), color);
        cloud.normals.assign(cloud.size(), normal);
        std::vector<float> heat;
        for (const Vec3f& p : cloud.positions) heat.push_back(p.x() + offset);
        cloud.attributes = {
            {"heat", heat, 1, Reduction::Mean},
            {"label", std::vector<std::uint8_t>(cloud.size(), label), 1, Reduction::Nearest},
            {offset > 0 ? "only_b" : "only_a", heat, 1, Reduction::Mean}};
    };
    dress(a, {255, 255, 255}, Vec3f::UnitZ(), 0, 3);
    dress(b, {0, 0, 0}, Vec3f::UnitX(), 0.5F, 7);
    const SurfaceError error = measure_error(a, b, {.samples = 2000, .attributes = true});
    for (const DirectedError& d : {error.forward, error.backward}) {
        ASSERT_EQ(d.attributes.size(), 4U);
        EXPECT_NEAR(attribute(d, "color").mean, 100, 1e-3);
        EXPECT_NEAR(attribute(d, "normal").mean, std::numbers::pi / 2, 1e-5);
        EXPECT_NEAR(attribute(d, "heat").mean, 0.5, 0.01);
        EXPECT_NEAR(attribute(d, "label").max, 4, 1e-6);
        EXPECT_NEAR(attribute(d, "label").rms, 4, 1e-6);
        EXPECT_EQ(attribute(d, "label").differing, 1);
        EXPECT_FALSE(attribute(d, "heat").differing);
    }
    const SurfaceError same = measure_error(a, a, {.samples = 2000, .attributes = true});
    EXPECT_LT(attribute(same.forward, "color").max, 1e-3);
    EXPECT_LT(attribute(same.forward, "heat").mean, 0.01);
    EXPECT_TRUE(measure_error(a, b, {.samples = 100}).forward.attributes.empty());
}

TEST(AttributeErrors, TellWhereLabelsDiffer) {
    PointCloud a = test::plane(4000), b = a;
    const auto label = [](PointCloud& cloud, float border) {
        std::vector<std::int32_t> labels;
        for (const Vec3f& p : cloud.positions) labels.push_back(p.x() < border ? 2 : 600);
        cloud.attributes = {{"label", labels, 1, Reduction::Nearest}};
    };
    const auto [low, high] =
        std::ranges::minmax(a.positions, {}, [](const Vec3f& p) { return p.x(); });
    label(a, low.x() + 0.5F * (high.x() - low.x()));
    label(b, low.x() + 0.7F * (high.x() - low.x()));
    const SurfaceError error = measure_error(a, b, {.attributes = true});
    for (const DirectedError& d : {error.forward, error.backward})
        EXPECT_NEAR(attribute(d, "label").differing.value(), 0.2, 0.02);
}

TEST(AttributeErrors, LeaveOutWhatIsNoNumberAmongNeighbours) {
    const auto with_heat = [](PointCloud cloud, float offset) {
        std::vector<float> heat;
        for (const Vec3f& p : cloud.positions)
            heat.push_back(heat.size() % 3 == 0   ? std::numeric_limits<float>::quiet_NaN()
                           : heat.size() % 7 == 0 ? std::numeric_limits<float>::infinity()
                                                  : p.x() + offset);
        cloud.attributes = {{"heat", heat, 1, Reduction::Mean}};
        return cloud;
    };
    const SurfaceError error =
        measure_error(with_heat(test::plane(3000), 0), with_heat(test::plane(1000, 2), 0.5F),
                      {.samples = 2000, .attributes = true});
    for (const DirectedError& d : {error.forward, error.backward}) {
        EXPECT_NEAR(attribute(d, "heat").mean, 0.5, 0.02);
        EXPECT_NEAR(attribute(d, "heat").max, 0.5, 0.1);
    }
}

TEST(AttributeErrors, OfACloudAndItselfAreNone) {
    PointCloud cloud = test::plane(44'000);  // of which points are taken as samples
    for (Vec3f& p : cloud.positions) p.z() = 0.3F * p.x() + 0.2F * p.y();
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const auto random = [&](std::uint64_t c) {
            return static_cast<std::uint8_t>(255 * random_unit(c, i));
        };
        cloud.colors.push_back({random(1), random(2), random(3), 255});
    }
    for (const std::uint64_t samples : {std::uint64_t{0}, std::uint64_t{3000}}) {
        const SurfaceError error =
            measure_error(cloud, cloud, {.samples = samples, .attributes = true});
        for (const DirectedError& d : {error.forward, error.backward})
            EXPECT_LT(attribute(d, "color").max, 0.01) << samples;
    }
}

TEST(AttributeErrors, CountNoNormalThatIsNone) {
    PointCloud a = test::plane(3000), b = a;
    a.normals.assign(a.size(), Vec3f::UnitZ());
    b.normals.assign(b.size(), Vec3f::Zero());
    const auto normal_of = [](const PointCloud& from, const PointCloud& to) {
        return attribute(measure_error(from, to, {.samples = 500, .attributes = true}).forward,
                         "normal");
    };
    EXPECT_THROW(normal_of(a, b), std::runtime_error) << "there is none to compare with";
    EXPECT_THROW(normal_of(b, a), std::runtime_error);
    for (std::size_t i = 0; i < b.size(); i += 20) b.normals[i] = Vec3f::UnitZ();
    EXPECT_LT(normal_of(a, b).max, 1e-6);
    EXPECT_LT(normal_of(b, a).max, 1e-6);
}

}  // namespace
}  // namespace stipple
