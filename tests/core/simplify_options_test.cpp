// What is refused at the door, before there is a cloud.
#include "stipple/error.hpp"
#include "stipple/simplify.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>

namespace stipple {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

template <typename Options>
std::string refusal(const Options& options) {
    try {
        validate(options);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::InvalidArgument);
        return error.what();
    }
    return "accepted";
}

SimplifyOptions to_five(Method method) {
    SimplifyOptions options;
    options.method = method;
    options.points = 5;
    return options;
}

/// The refusal of five points by `method` after `change`.
template <typename Change>
std::string refusal(Method method, Change&& change) {
    SimplifyOptions options = to_five(method);
    change(options);
    return refusal(options);
}

TEST(Method, NamesGoBothWays) {
    for (const Method method : kMethods) EXPECT_EQ(method_from_name(to_string(method)), method);
    test::expect_refused("method magic: expected one of multiphase, ",
                         [&] { method_from_name("magic"); });
}

TEST(SimplifyOptions, OfEveryMethodAreValidWithATargetAlone) {
    for (const Method method : kMethods) {
        EXPECT_EQ(refusal(to_five(method)), "accepted") << to_string(method);
        SimplifyOptions none = to_five(method);
        none.points.reset();
        EXPECT_TRUE(refusal(none).starts_with("target: expected exactly one of points"))
            << to_string(method);
    }
}

TEST(SimplifyOptions, TakeBoundsOfTheMethodInPlaceOfATarget) {
    const auto bounded = [](Method method, auto&& change) {
        SimplifyOptions options;
        options.method = method;
        change(options);
        return refusal(options);
    };
    EXPECT_EQ(bounded(Method::Hierarchical, [](auto& o) { o.hierarchical.max_variation = 0.1; }),
              "accepted");
    EXPECT_EQ(bounded(Method::Incremental, [](auto& o) { o.incremental.max_cluster_size = 9; }),
              "accepted");
    EXPECT_EQ(bounded(Method::Voxel, [](auto& o) { o.voxel.voxel_size = 0.5; }), "accepted");
    // Those of another method are not read.
    EXPECT_NE(bounded(Method::Voxel, [](auto& o) { o.hierarchical.max_variation = 0.1; }),
              "accepted");
}

TEST(SimplifyOptions, TakeAVariationBesideATargetForIncrementalAlone) {
    EXPECT_EQ(refusal(Method::Incremental, [](auto& o) { o.incremental.max_variation = 0.1; }),
              "accepted");
    EXPECT_NE(refusal(Method::Incremental, [](auto& o) { o.incremental.max_cluster_size = 9; }),
              "accepted");
    EXPECT_NE(refusal(Method::Hierarchical, [](auto& o) { o.hierarchical.max_variation = 0.1; }),
              "accepted");
}

TEST(SimplifyOptions, OutOfRangeAreRefusedWithNameValueAndLimit) {
    using enum Method;
    EXPECT_EQ(refusal(Multiphase, [](auto& o) { o.oversampling = 0.5; }),
              "oversampling 0.5: expected 1 to 1000");
    for (const Method method : {Multiphase, Iterative}) {
        EXPECT_EQ(refusal(method, [](auto& o) { o.iterative.k = 2; }), "k 2: expected 3..32");
        EXPECT_EQ(refusal(method, [](auto& o) { o.iterative.max_displacement = -1; }),
                  "max_displacement -1: expected a finite number, at least 0");
        EXPECT_EQ(refusal(method, [](auto& o) { o.iterative.color_weight = -1; }),
                  "color_weight -1: expected a finite number, at least 0");
        EXPECT_EQ(refusal(method, [](auto& o) { o.iterative.attribute_weights["w"] = kNan; }),
                  "attribute_weights.w nan: expected a finite number, at least 0");
    }
    EXPECT_EQ(refusal(Incremental, [](auto& o) { o.incremental.max_variation = 0.5; }),
              "max_variation 0.5: expected above 0, at most 1/3");
    EXPECT_EQ(refusal(Particles, [](auto& o) { o.particles.adaptivity = 1.5; }),
              "adaptivity 1.5: expected 0 to 1");
    EXPECT_EQ(refusal(Particles, [](auto& o) { o.particles.max_grading = 0.5; }),
              "max_grading 0.5: expected a finite number, at least 1");
    EXPECT_EQ(refusal(Particles, [](auto& o) { o.particles.max_iterations = 0; }),
              "max_iterations 0: expected at least 1");
    EXPECT_EQ(refusal(Particles, [](auto& o) { o.particles.tolerance = 1; }),
              "tolerance 1: expected above 0, below 1");
    EXPECT_EQ(refusal(Random, [](auto& o) { o.reductions["w"] = Reduction::Max; }),
              "reductions: random keeps points as they are");
    EXPECT_EQ(refusal(Voxel,
                      [](auto& o) {
                          o.points.reset();
                          o.voxel.voxel_size = -1;
                      }),
              "voxel_size -1: expected a finite number above 0");
}

TEST(SimplifyOptions, RefuseRegionsThatSayNothing) {
    const auto refused = [](const DensityRegion& region) {
        return refusal(Method::Particles, [&](auto& o) { o.particles.regions = {region}; });
    };
    EXPECT_EQ(refused({.where = DensityRegion::Sphere{Vec3d::Zero(), 1}, .density = 2}),
              "accepted");
    EXPECT_NE(refused({.where = DensityRegion::Sphere{Vec3d::Zero(), 0}, .density = 2}),
              "accepted");
    EXPECT_NE(refused({.where = DensityRegion::Sphere{Vec3d::Constant(kNan), 1}, .density = 2}),
              "accepted");
    EXPECT_NE(refused({.where = DensityRegion::Box{Vec3d::Ones(), Vec3d::Zero()}, .density = 2}),
              "accepted");
    EXPECT_NE(refused({.where = DensityRegion::Scalar{"w", 2, 1}, .density = 2}), "accepted");
    EXPECT_NE(refused({.where = DensityRegion::Scalar{"w", 1, 2}, .density = 0}), "accepted");
    EXPECT_EQ(refused({.where = DensityRegion::Scalar{"w", 1, 2}, .density = 1e7}),
              "regions[0]: density 1e+07: expected 1e-06..1e+06");
    EXPECT_NE(refused({.where = DensityRegion::Scalar{"w", 1, 2}, .density = 2, .transition = -1}),
              "accepted");
}

TEST(UpsampleOptions, TakeOneTargetAboveTheCount) {
    EXPECT_EQ(refusal(UpsampleOptions{}), "target: expected exactly one of points and ratio");
    EXPECT_EQ(refusal(UpsampleOptions{.points = 5, .ratio = 2.0}),
              "target: expected exactly one of points and ratio");
    EXPECT_EQ(refusal(UpsampleOptions{.ratio = 1.0}), "ratio 1: expected a finite number above 1");
    const PointCloud cloud = test::sphere(300);
    EXPECT_EQ(upsample(cloud, {.ratio = 1.5}).size(), 450U);
    EXPECT_EQ(upsample(cloud, {.points = 301}).size(), 301U);
    test::expect_refused("points 300: expected more than the 300 of the cloud",
                         [&] { upsample(cloud, {.points = 300}); });
    test::expect_refused("the cloud has no points", [&] { upsample({}, {.points = 300}); });
    test::expect_refused("ratio 1e+09: expected fewer than 2^32 points",
                         [&] { upsample(cloud, {.ratio = 1e9}); });  // above 2^32 points
}

}  // namespace
}  // namespace stipple
