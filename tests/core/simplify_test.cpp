#include "stipple/simplify.hpp"

#include "stipple/cleaning.hpp"
#include "stipple/error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <chrono>
#include <cmath>
#include <functional>
#include <numeric>
#include <thread>

// What holds for every method.
namespace stipple {
namespace {

struct Shape {
    const char* name;
    std::function<PointCloud()> make;
};

PointCloud with_offset(PointCloud cloud, const Vec3f& offset) {
    for (Vec3f& p : cloud.positions) p += offset;
    return cloud;
}

PointCloud with_bad_points(PointCloud cloud) {
    for (std::size_t i = 0; i < cloud.size(); i += 7) cloud.positions[i].y() = std::nanf("");
    for (std::size_t i = 3; i < cloud.size(); i += 11) cloud.positions[i] = cloud.positions[2];
    return cloud;
}

const Shape kShapes[] = {
    {"Sphere", [] { return test::sphere(3000); }},
    {"NoisySphere", [] { return test::sphere(3000, 0.1); }},
    {"Plane", [] { return test::plane(3000); }},
    {"Line", [] { return test::line(1000); }},
    {"Volume", [] { return test::cube(3000); }},
    {"FarAway",
     [] {
         return with_offset(test::sphere(3000), {5e5F, -3e5F, 1e5F});
     }},
    {"Tiny", [] { return test::sphere(3); }},
    {"BadPoints", [] { return with_bad_points(test::sphere(3000)); }},
};

class EveryMethod : public testing::TestWithParam<std::tuple<Method, std::size_t>> {
protected:
    Method method() const { return std::get<0>(GetParam()); }
    PointCloud cloud() const {
        PointCloud result = test::with_attributes(kShapes[std::get<1>(GetParam())].make());
        clean(result);
        return result;
    }
    PointCloud run(const PointCloud& input, std::uint64_t points,
                   const RunContext& context = {}) const {
        SimplifyOptions options;
        options.method = method();
        options.points = points;
        return simplify(input, options, context);
    }
};

TEST_P(EveryMethod, GivesExactlyTheCountAskedFor) {
    const PointCloud input = cloud();
    for (const std::size_t n :
         {std::size_t{1}, std::size_t{2}, input.size() / 3 + 1, input.size() - 1, input.size()}) {
        if (n == 0) continue;
        EXPECT_EQ(run(input, n).size(), n);
    }
}

TEST_P(EveryMethod, GivesTheCloudItselfForATargetAboveItsCount) {
    const PointCloud input = cloud();
    EXPECT_EQ(run(input, input.size() + 1000).positions, input.positions);
}

TEST_P(EveryMethod, KeepsEveryAttributeAndNoNaN) {
    const PointCloud input = cloud();
    const PointCloud result = run(input, input.size() / 2 + 1);
    EXPECT_NO_THROW(validate(result));
    ASSERT_EQ(result.normals.size(), result.size());
    ASSERT_EQ(result.colors.size(), result.size());
    ASSERT_EQ(result.attributes.size(), input.attributes.size());
    for (std::size_t i = 0; i < result.size(); ++i) {
        EXPECT_TRUE(result.positions[i].allFinite());
        EXPECT_NEAR(result.normals[i].norm(), 1.0F, 1e-4F);
    }
    for (const std::int32_t label :
         std::get<std::vector<std::int32_t>>(find_attribute(result, "label")->values)) {
        EXPECT_TRUE(label == 7 || label == 1'000'003) << "a label was blended: " << label;
    }
}

TEST_P(EveryMethod, StaysInTheBoxOfTheInput) {
    const PointCloud input = cloud();
    const Aabb box = bounds(input), inner = bounds(run(input, input.size() / 4 + 1));
    const double slack = 0.05 * box.diagonal();
    EXPECT_TRUE((inner.min.array() >= box.min.array() - slack).all());
    EXPECT_TRUE((inner.max.array() <= box.max.array() + slack).all());
}

TEST_P(EveryMethod, GivesTheSameBytesForAnyNumberOfThreads) {
    const PointCloud input = cloud();
    const std::uint64_t n = input.size() / 5 + 1;
    const PointCloud one = run(input, n, {.threads = 1});
    for (const unsigned threads : {2U, 7U, 8U}) {
        const PointCloud other = run(input, n, {.threads = threads});
        EXPECT_EQ(one.positions, other.positions);
        EXPECT_EQ(one.normals, other.normals);
        EXPECT_EQ(one.colors, other.colors);
        for (std::size_t a = 0; a < one.attributes.size(); ++a) {
            EXPECT_EQ(one.attributes[a].values, other.attributes[a].values);
        }
    }
}

TEST_P(EveryMethod, ReportsProgressThatNeverGoesBack) {
    double last = 0;
    run(cloud(), 2, {.progress = [&](double fraction) {
            EXPECT_GE(fraction, last);
            last = fraction;
        }});
    EXPECT_EQ(last, cloud().size() <= 2 ? last : 1.0);
}

INSTANTIATE_TEST_SUITE_P(Clouds, EveryMethod,
                         testing::Combine(testing::Values(Method::Hierarchical),
                                          testing::Range(std::size_t{0}, std::size(kShapes))),
                         [](const auto& instance) {
                             return std::string(to_string(std::get<0>(instance.param))) +
                                    kShapes[std::get<1>(instance.param)].name;
                         });

TEST(Simplify, LargeCloudsGiveTheSameBytesForAnyNumberOfThreads) {
    const PointCloud input = test::sphere(200'000, 0.01);
    SimplifyOptions options;
    options.points = 9'999;
    const PointCloud one = simplify(input, options, {.threads = 1});
    EXPECT_EQ(one.size(), 9'999U);
    EXPECT_EQ(one.positions, simplify(input, options, {.threads = 8}).positions);
}

TEST(Simplify, OfEqualPointsLeavesOne) {
    PointCloud cloud;
    cloud.positions.assign(1000, Vec3f(1, 2, 3));
    EXPECT_EQ(clean(cloud).duplicates, 999U);
    SimplifyOptions options;
    options.points = 10;
    EXPECT_EQ(simplify(cloud, options).size(), 1U);
}

TEST(Simplify, ARatioRoundsToAtLeastOnePoint) {
    const PointCloud input = test::cube(1000);
    SimplifyOptions options;
    options.ratio = 0.0105;
    EXPECT_EQ(simplify(input, options).size(), 11U);
    options.ratio = 1e-9;
    EXPECT_EQ(simplify(input, options).size(), 1U);
    options.ratio = 1.0;
    EXPECT_EQ(simplify(input, options).size(), 1000U);
}

TEST(Simplify, StopsSoonAfterBeingAsked) {
    const PointCloud input = test::sphere(1'000'000, 0.01);
    std::stop_source source;
    std::jthread stopper([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        source.request_stop();
    });
    SimplifyOptions options;
    options.points = 500'000;
    EXPECT_THROW(simplify(input, options, {.stop = source.get_token()}), Cancelled);
}

TEST(Simplify, RefusesTargetsThatAreNoneOrTwoOrOutOfRange) {
    const PointCloud input = test::cube(10);
    EXPECT_THROW(simplify(input, {}), Error);
    SimplifyOptions both;
    both.points = 3;
    both.ratio = 0.5;
    EXPECT_THROW(simplify(input, both), Error);
    for (const double ratio : {0.0, -0.1, 1.1, std::nan("")}) {
        SimplifyOptions options;
        options.ratio = ratio;
        EXPECT_THROW(simplify(input, options), Error) << ratio;
    }
}

TEST(Simplify, NamesTheAttributesThereAreWhenAReductionNamesAnother) {
    SimplifyOptions options;
    options.points = 3;
    options.reductions["intensiti"] = Reduction::Max;
    try {
        simplify(test::with_attributes(test::cube(10)), options);
        FAIL() << "expected an error";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::InvalidArgument);
        EXPECT_STREQ(error.what(),
                     "reductions: no attribute intensiti; the cloud has: height, label");
    }
}

TEST(Simplify, ARequestedReductionStandsInsteadOfTheDefault) {
    PointCloud input = test::with_attributes(test::sphere(1000));
    SimplifyOptions options;
    options.points = 1;
    options.hierarchical.representative = Representative::Centroid;
    options.reductions["height"] = Reduction::Max;
    const PointCloud result = simplify(input, options);
    EXPECT_NEAR(std::get<std::vector<float>>(find_attribute(result, "height")->values).front(),
                1.0F, 0.01F);
}

}  // namespace
}  // namespace stipple
