#include "stipple/simplify.hpp"

#include "base/kernel_sets.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/error.hpp"
#include "stipple/surface_attributes.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
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

PointCloud scaled(PointCloud cloud, float by) {
    for (Vec3f& p : cloud.positions) p *= by;
    return cloud;
}

PointCloud with_bad_points(PointCloud cloud) {
    for (std::size_t i = 0; i < cloud.size(); i += 7) cloud.positions[i].y() = std::nanf("");
    return cloud;
}

PointCloud with_duplicates(PointCloud cloud) {
    for (std::size_t i = 3; i < cloud.size(); i += 5) cloud.positions[i] = cloud.positions[i / 2];
    return cloud;
}

PointCloud with_holes(PointCloud cloud) {
    std::erase_if(cloud.positions, [](const Vec3f& p) {
        return (p - Vec3f(0, 0, 1)).norm() < 0.7F || (p - Vec3f(1, 0, 0)).norm() < 0.3F;
    });
    return cloud;
}

const Shape kShapes[] = {
    {"Sphere", [] { return test::sphere(1000); }},
    {"Noisy", [] { return test::sphere(1000, 0.1); }},
    {"Holed", [] { return with_holes(test::sphere(1000)); }},
    {"Duplicated", [] { return with_duplicates(test::sphere(1000)); }},
    {"Plane", [] { return test::plane(1000); }},
    {"Line", [] { return test::line(500); }},
    {"Volume", [] { return test::cube(1000); }},
    {"FarAway",
     [] {
         return with_offset(test::sphere(1000), {5e5F, -3e5F, 1e5F});
     }},
    {"Huge", [] { return scaled(test::sphere(1000), 1e15F); }},
    {"Minute", [] { return scaled(test::sphere(1000), 1e-15F); }},
    {"ThreePoints", [] { return test::sphere(3); }},
    {"BadPoints", [] { return with_bad_points(test::sphere(1000)); }},
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

TEST_P(EveryMethod, ReducesEachAttributeByItsPolicy) {
    if (method() == Method::Random) return;  // which keeps points as they are
    PointCloud input = cloud();
    std::vector<float> values;
    for (std::size_t i = 0; i < input.size(); ++i)
        values.push_back(static_cast<float>(i * 7919 % 1'009));
    SimplifyOptions options;
    options.method = method();
    options.points = input.size() / 3 + 1;
    for (const auto& [name, reduction] : {std::pair("least", Reduction::Min),
                                          {"mean", Reduction::Mean},
                                          {"most", Reduction::Max}}) {
        input.attributes.push_back({name, values, 1, Reduction::Nearest});
        options.reductions[name] = reduction;
    }
    const PointCloud result = simplify(input, options);
    const auto values_of = [&](const char* name) {
        return std::get<std::vector<float>>(find_attribute(result, name)->values);
    };
    const auto least = values_of("least"), mean = values_of("mean"), most = values_of("most");
    std::size_t merged = 0;
    for (std::size_t i = 0; i < result.size(); ++i) {
        EXPECT_LE(least[i], mean[i] * 1.0001F);
        EXPECT_LE(mean[i], most[i] * 1.0001F);
        merged += least[i] < mean[i] && mean[i] < most[i];
    }
    if (input.size() > 100) {
        EXPECT_GT(2 * merged, result.size() / 2);
    }
}

TEST_P(EveryMethod, LeavesPointsWithASplatEach) {
    const PointCloud input = cloud();
    PointCloud result = run(input, input.size() / 3 + 1);
    add_splats(result, SplatAttributes::Ellipse);
    const auto values_of = [&](const char* name) {
        return std::get<std::vector<float>>(find_attribute(result, name)->values);
    };
    const auto radius = values_of("radius"), major = values_of("major"), minor = values_of("minor");
    ASSERT_EQ(radius.size(), result.size());
    ASSERT_EQ(major.size(), 3 * result.size());
    ASSERT_EQ(minor.size(), 3 * result.size());
    const auto largest = static_cast<float>(bounds(input).diagonal());
    for (std::size_t i = 0; i < result.size(); ++i) {
        EXPECT_GT(radius[i], 0.0F);
        EXPECT_LE(radius[i], largest);
        const Vec3f a(&major[3 * i]), b(&minor[3 * i]);
        EXPECT_GE(a.stableNorm(), b.stableNorm() * 0.9999F);
        EXPECT_LE(a.stableNorm(), largest);
        EXPECT_NEAR(a.stableNormalized().dot(b.stableNormalized()), 0.0F, 1e-3F);
    }
}

/// Distance to the nearest of the points.
float distance_to(const std::vector<Vec3f>& points, const Vec3f& place) {
    float least = std::numeric_limits<float>::infinity();
    for (const Vec3f& p : points) least = std::min(least, (p - place).stableNorm());
    return least;
}

TEST_P(EveryMethod, AnAttributeOfNumbersIsAMapToTheInput) {
    PointCloud input = cloud();
    std::vector<std::uint32_t> numbers(input.size());
    std::iota(numbers.begin(), numbers.end(), 0U);
    input.attributes.push_back({"source_index", numbers, 1, Reduction::Nearest});
    const PointCloud result = run(input, input.size() / 3 + 1);
    const auto& source =
        std::get<std::vector<std::uint32_t>>(find_attribute(result, "source_index")->values);
    ASSERT_EQ(source.size(), result.size());
    // The nearest of the points that one stands for is mostly the nearest of all, and never far.
    const float spacing = static_cast<float>(bounds(input).diagonal() /
                                             std::sqrt(static_cast<double>(result.size())));
    std::size_t nearest = 0;
    for (std::size_t i = 0; i < result.size(); ++i) {
        ASSERT_LT(source[i], input.size());
        const float to_source = (input.positions[source[i]] - result.positions[i]).stableNorm();
        const float least = distance_to(input.positions, result.positions[i]);
        nearest += to_source <= least * 1.0001F;
        EXPECT_LE(to_source, least + spacing);
    }
    EXPECT_GE(static_cast<double>(nearest), 0.8 * static_cast<double>(result.size()));
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

TEST_P(EveryMethod, GivesTheSameBytesWithThePlainKernels) {
    const PointCloud input = cloud();
    for (const std::uint64_t n : {input.size() / 20 + 1, input.size() / 3 + 1}) {
        const PointCloud quick = run(input, n);
        const PlainKernelsOnly plain_only;
        const PointCloud plain = run(input, n);
        EXPECT_EQ(quick.positions, plain.positions);
        EXPECT_EQ(quick.normals, plain.normals);
        EXPECT_EQ(quick.colors, plain.colors);
        for (std::size_t a = 0; a < quick.attributes.size(); ++a)
            EXPECT_EQ(quick.attributes[a].values, plain.attributes[a].values);
    }
}

TEST_P(EveryMethod, ReportsProgressThatNeverGoesBack) {
    const PointCloud input = cloud();
    double last = 0;
    run(input, 2, {.progress = [&](double fraction) {
            EXPECT_GE(fraction, last);
            last = fraction;
        }});
    EXPECT_EQ(last, 1.0);
}

TEST_P(EveryMethod, StopsWhenAskedToAtAnyReport) {
    const PointCloud input = cloud();
    const std::uint64_t n = input.size() / 4 + 1;
    std::size_t reports = 0;
    run(input, n, {.progress = [&](double) { ++reports; }});
    for (std::size_t stop_at = 0; stop_at < reports; stop_at += reports / 4 + 1) {
        std::stop_source source;
        if (stop_at == 0) source.request_stop();
        std::size_t seen = 0;
        const RunContext context = {.stop = source.get_token(), .progress = [&](double) {
                                        if (++seen == stop_at) source.request_stop();
                                    }};
        EXPECT_THROW(run(input, n, context), Cancelled);
        EXPECT_EQ(seen, stop_at) << "it went on after it was asked to stop";
    }
}

INSTANTIATE_TEST_SUITE_P(Clouds, EveryMethod,
                         testing::Combine(testing::ValuesIn(kMethods),
                                          testing::Range(std::size_t{0}, std::size(kShapes))),
                         [](const auto& instance) {
                             return std::string(to_string(std::get<0>(instance.param))) +
                                    kShapes[std::get<1>(instance.param)].name;
                         });

class AnyMethod : public testing::TestWithParam<Method> {};

TEST_P(AnyMethod, OnALargeCloudGivesTheSameBytesForAnyNumberOfThreads) {
    const PointCloud input = test::sphere(100'000, 0.01);
    SimplifyOptions options;
    options.method = GetParam();
    options.points = 2'999;
    const PointCloud one = simplify(input, options, {.threads = 1});
    EXPECT_EQ(one.size(), 2'999U);
    EXPECT_EQ(one.positions, simplify(input, options, {.threads = 8}).positions);
}

INSTANTIATE_TEST_SUITE_P(Methods, AnyMethod, testing::ValuesIn(kMethods), [](const auto& instance) {
    return std::string(to_string(instance.param));
});

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

/// What is said of refused options.
std::string refusal(const PointCloud& cloud, const SimplifyOptions& options) {
    try {
        simplify(cloud, options);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::InvalidArgument);
        return error.what();
    }
    ADD_FAILURE() << to_string(options.method) << ": expected an error";
    return {};
}

TEST_P(AnyMethod, RefusesTargetsThatAreNoneOrTwoOrOutOfRange) {
    const PointCloud input = test::cube(10);
    SimplifyOptions options;
    options.method = GetParam();
    EXPECT_NE(refusal(input, options).find("target: expected exactly one of points"),
              std::string::npos);
    options.points = 0;
    EXPECT_EQ(refusal(input, options), "points 0: expected at least 1");
    options.points = 3;
    EXPECT_EQ(refusal({}, options), "the cloud has no points: expected at least 1");
    options.ratio = 0.5;
    refusal(input, options);
    options.points.reset();
    for (const double ratio : {0.0, -0.1, 1.1, std::nan("")}) {
        options.ratio = ratio;
        EXPECT_NE(refusal(input, options).find(": expected above 0, at most 1"), std::string::npos);
    }
}

TEST_P(AnyMethod, NamesTheAttributesThereAreWhenAReductionNamesAnother) {
    SimplifyOptions options;
    options.method = GetParam();
    options.reductions["intensiti"] = Reduction::Max;
    for (const std::uint64_t points : {3U, 10U, 20U}) {  // of 10
        options.points = points;
        const std::string message = refusal(test::with_attributes(test::cube(10)), options);
        EXPECT_EQ(message,
                  GetParam() == Method::Random
                      ? "reductions: random keeps points as they are"
                      : "reductions: no attribute intensiti; the cloud has: normal, color, "
                        "height, label");
    }
}

TEST_P(AnyMethod, RefusesACloudThatWasNotCleaned) {
    constexpr float kNaN = std::numeric_limits<float>::quiet_NaN(),
                    kInfinity = std::numeric_limits<float>::infinity();
    for (const float bad : {kNaN, kInfinity, -kInfinity}) {
        PointCloud cloud = test::sphere(2'000);
        for (std::size_t i = 0; i < cloud.size(); i += 7) cloud.positions[i].y() = bad;
        test::expect_error(ErrorCode::InvalidArgument, "positions: expected finite coordinates",
                           [&] { simplify(cloud, {.method = GetParam(), .points = 200}); });
    }
}

TEST_P(AnyMethod, RefusesArraysOfAnotherLength) {
    SimplifyOptions options;
    options.method = GetParam();
    options.points = 50;
    PointCloud input = test::sphere(200);
    input.colors.resize(10);
    EXPECT_EQ(refusal(input, options), "colors: 10 values for 200 points of 1");
    input.colors.clear();
    input.attributes = {{"height", std::vector<float>(7), 1, Reduction::Mean}};
    EXPECT_EQ(refusal(input, options), "attribute height: 7 values for 200 points of 1");
}

TEST(Simplify, OfWhatHasNoDistancesEndsWithSomePoints) {
    PointCloud input = test::sphere(200);
    for (Vec3f& p : input.positions) p *= 3e38F;
    SimplifyOptions options;
    options.method = Method::Hierarchical;
    options.points = 20;
    EXPECT_EQ(simplify(input, options).size(), 20U);
}

TEST(Simplify, ARequestedReductionStandsInsteadOfTheDefault) {
    PointCloud input = test::with_attributes(test::sphere(1000));
    SimplifyOptions options;
    options.method = Method::Hierarchical;
    options.points = 1;
    options.hierarchical.representative = Representative::Centroid;
    options.reductions["height"] = Reduction::Max;
    const PointCloud result = simplify(input, options);
    EXPECT_NEAR(std::get<std::vector<float>>(find_attribute(result, "height")->values).front(),
                1.0F, 0.01F);
}

TEST(Simplify, TakesAPolicyOfColoursAndNormals) {
    PointCloud cloud = test::sphere(1'000);
    cloud.colors.assign(cloud.size(), {0, 0, 0, 255});
    for (std::size_t i = 0; i < cloud.size(); i += 2) cloud.colors[i] = {255, 255, 255, 255};
    SimplifyOptions options;
    options.method = Method::Hierarchical;
    options.points = 10;
    const auto is_gray = [](const Rgba8& c) { return c.r > 0 && c.r < 255; };
    EXPECT_TRUE(std::ranges::none_of(simplify(cloud, options).colors, is_gray));
    options.reductions["color"] = Reduction::Mean;
    EXPECT_TRUE(std::ranges::all_of(simplify(cloud, options).colors, is_gray));
    options.method = Method::Multiphase;
    options.reductions["color"] = Reduction::Nearest;
    EXPECT_TRUE(std::ranges::none_of(simplify(cloud, options).colors, is_gray));
    options.reductions["color"] = Reduction::Max;
    EXPECT_EQ(refusal(cloud, options),
              "reductions: color by min, max or mode: expected mean or nearest");
    options.reductions = {{"normal", Reduction::Mean}};
    EXPECT_EQ(refusal(cloud, options), "reductions: no attribute normal; the cloud has: color");
}

}  // namespace
}  // namespace stipple
