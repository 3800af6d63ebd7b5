#include "stipple/error_bounded.hpp"

#include "analysis/planar_hull.hpp"
#include "error/error_judge.hpp"
#include "error/foot_finder.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/error.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stipple {
namespace {

using test::sphere;

SimplifyOptions within(double error, Method method = Method::Hierarchical) {
    SimplifyOptions options;
    options.method = method;
    options.max_error = error;
    return options;
}

/// A sphere with a small bump: coarse points do for most of it.
PointCloud bumpy_sphere(std::size_t n) {
    PointCloud cloud = sphere(n);
    for (Vec3f& p : cloud.positions) {
        const float from_pole_sq = (p - Vec3f::UnitZ()).squaredNorm();
        p *= 1 + 0.1F * std::exp(-from_pole_sq / 0.02F);
    }
    return cloud;
}

/// The finest first.
std::vector<CurvePoint> curve_of(const PointCloud& cloud, Method method,
                                 const std::vector<std::uint64_t>& ascending,
                                 std::uint64_t samples = 4'000) {
    std::vector<CurvePoint> curve;
    error_curve(cloud, {.simplification = {.method = method}, .points = ascending},
                [&](const CurvePoint& point) { curve.push_back(point); }, {.samples = samples});
    return curve;
}

/// By other samples than any that the search took.
double measured_again(const PointCloud& cloud, const PointCloud& candidate,
                      ErrorSampling sampling) {
    const SurfaceErrorOptions options{.sampling = sampling, .samples = 48'000, .seed = 77};
    return measure_error(cloud, candidate, options).max();
}

/// The smallest count of one run whose snapshot is within the bound, at random places and at the
/// points themselves, which lie off the surface where it is curved. Counts are a tenth apart.
std::size_t fewest_of_all(const PointCloud& cloud, const SimplifyOptions& options) {
    std::vector<std::uint64_t> counts;
    for (double n = 0.8 * static_cast<double>(cloud.size()); n > 40; n /= 1.1)
        counts.push_back(static_cast<std::uint64_t>(n));
    std::ranges::reverse(counts);
    std::size_t fewest = cloud.size();
    const auto between = curve_of(cloud, options.method, counts, 48'000);
    const auto at_points = curve_of(cloud, options.method, counts, cloud.size());
    for (std::size_t i = 0; i < between.size(); ++i)
        if (std::max(between[i].error.max(), at_points[i].error.max()) <= *options.max_error)
            fewest = std::min(fewest, between[i].points);
    return fewest;
}

class ErrorBounded : public testing::TestWithParam<Method> {};

TEST_P(ErrorBounded, HoldsWhenMeasuredAgainWithFewPoints) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    const PointCloud cloud = bumpy_sphere(1'200);
    const double bound = GetParam() == Method::Particles ? 0.06 : 0.03;
    const SimplifyOptions options = within(bound, GetParam());
    const ErrorBoundedCloud found = simplify_within_error(cloud, options);
    EXPECT_FALSE(found.whole);
    EXPECT_EQ(found.bound, bound);
    EXPECT_LE(found.error.max(), bound);
    EXPECT_GT(found.error.max(), 0.1 * bound);
    EXPECT_GT(found.tries, 2U);
    EXPECT_LE(measured_again(cloud, found.cloud, ErrorSampling::Points), bound * 1.02);
    EXPECT_LE(measure_error(cloud, found.cloud).max(), bound);
    EXPECT_LE(static_cast<double>(found.cloud.size()),
              1.3 * static_cast<double>(fewest_of_all(cloud, options)));
}

/// So few points that sanitizers see the search of every method.
TEST_P(ErrorBounded, HoldsForASmallCloud) {
    const PointCloud cloud = test::with_attributes(bumpy_sphere(200));
    constexpr double kBound = 0.25;
    const ErrorBoundedCloud found = simplify_within_error(cloud, within(kBound, GetParam()));
    EXPECT_FALSE(found.whole);
    EXPECT_LT(2 * found.cloud.size(), cloud.size());
    EXPECT_LE(found.error.max(), kBound);
    EXPECT_GT(found.tries, 1U);
    EXPECT_EQ(found.cloud.colors.size(), found.cloud.size());
    const SurfaceErrorOptions again{
        .sampling = ErrorSampling::Surface, .samples = 4'000, .seed = 77};
    EXPECT_LE(measure_error(cloud, found.cloud, again).max(), kBound * 1.02);
}

INSTANTIATE_TEST_SUITE_P(Methods, ErrorBounded, testing::ValuesIn(kErrorBoundedMethods),
                         [](const auto& p) { return std::string(to_string(p.param)); });

/// A sphere with two sharp horns, which evenly spread particles never reach.
PointCloud horned_sphere(std::size_t n) {
    PointCloud cloud = sphere(n);
    for (Vec3f& p : cloud.positions) {
        const float away = std::hypot(p.x(), p.y());
        if (away < 0.15F) p.z() *= 1 + 0.5F * (1 - away / 0.15F);
    }
    return cloud;
}

TEST(ErrorBounded, TakesPlacesFromSeveralCountsWhereNoOneCountHolds) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    const PointCloud cloud = horned_sphere(3'000);
    const ErrorBoundedCloud found = simplify_within_error(cloud, within(0.03, Method::Particles));
    EXPECT_FALSE(found.whole);
    EXPECT_LE(found.error.max(), 0.03);
    EXPECT_LT(2 * found.cloud.size(), cloud.size());
    EXPECT_LE(measured_again(cloud, found.cloud, ErrorSampling::Surface), 0.03 * 1.02);
}

TEST(ErrorBounded, ParticlesAreFewerWhereTheBoundIsLooser) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    const PointCloud cloud = horned_sphere(1'500);  // one count for all holds for neither
    const auto size_within = [&](double bound) {
        return simplify_within_error(cloud, within(bound, Method::Particles)).cloud.size();
    };
    EXPECT_LT(size_within(0.08), size_within(0.04));
}

TEST(ErrorBounded, SaysWhatKeptItFromFewerPoints) {
    PointCloud cloud = sphere(200);
    cloud.origin = {1000, 0, 0};
    const ErrorBoundedCloud found = simplify_within_error(cloud, within(0.03));
    ASSERT_TRUE(found.whole);
    ASSERT_TRUE(found.too_far);
    EXPECT_LT(found.too_far->points, cloud.size());
    EXPECT_GT(found.too_far->points, cloud.size() / 2);
    EXPECT_GT(found.too_far->distance, 0.03);
    EXPECT_LT(found.too_far->distance, 0.1);
    EXPECT_NEAR((found.too_far->place - cloud.origin).norm(), 1, 0.1);
}

TEST(ErrorBounded, SaysThatABoundIsBelowTheNoise) {
    PointCloud cloud = sphere(2'000);
    for (std::size_t i = 0; i < cloud.size(); i += 20) cloud.positions[i] *= 1.05F;
    const ErrorBoundedCloud found = simplify_within_error(cloud, within(0.02));
    ASSERT_TRUE(found.whole);
    ASSERT_TRUE(found.too_far);
    EXPECT_EQ(found.too_far->points, cloud.size());
    EXPECT_NEAR(found.too_far->place.norm(), 1.05, 1e-5);  // a point that is off
    EXPECT_GT(found.too_far->distance, 0.02);
    EXPECT_LT(found.too_far->distance, 0.06);
}

TEST(ErrorBounded, DoesNotFollowAFewPointsThatAreOffTheSurface) {
    PointCloud cloud = sphere(2'000);
    for (const std::size_t stray : {100U, 900U, 1'700U}) cloud.positions[stray] *= 1.03F;
    const ErrorBoundedCloud found = simplify_within_error(cloud, within(0.02));
    EXPECT_FALSE(found.whole);
    EXPECT_GT(found.points_off_surface, 0U);
    EXPECT_LE(measured_again(cloud, found.cloud, ErrorSampling::Surface), 0.02 * 1.02);
}

TEST(ErrorBounded, AFewPointsThatAreOffTheSurfaceDoNotKeepAllOthers) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    PointCloud cloud = horned_sphere(3'000);
    // On the horn, where all points are needed.
    for (std::size_t i = 0; i < cloud.size(); ++i)
        if (cloud.positions[i].z() > 1.2F && i % 16 == 0) cloud.positions[i] += Vec3f(0.1F, 0, 0);
    const ErrorBoundedCloud found = simplify_within_error(cloud, within(0.02));
    EXPECT_GT(found.points_off_surface, 0U);
    EXPECT_FALSE(found.whole);
    EXPECT_LE(measured_again(cloud, found.cloud, ErrorSampling::Surface), 0.02 * 1.02);
}

TEST(ErrorBounded, OfALargeCloudFewPointsHold) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    const PointCloud cloud = bumpy_sphere(210'000);
    const ErrorBoundedCloud found = simplify_within_error(cloud, within(0.02));
    EXPECT_LT(found.cloud.size(), 3'000U);
    EXPECT_LE(measured_again(cloud, found.cloud, ErrorSampling::Surface), 0.02 * 1.02);
    EXPECT_LE(measured_again(cloud, found.cloud, ErrorSampling::Points), 0.02 * 1.02);
}

TEST(ErrorBounded, HoldsAtFourTimesAsManyPlaces) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    const PointCloud cloud = bumpy_sphere(1'000);
    const ErrorBoundedCloud found = simplify_within_error(cloud, within(0.04, Method::Multiphase));
    const std::uint64_t samples = 4 * found.error.forward.samples;
    for (std::uint64_t seed = 100; seed < 102; ++seed) {
        const SurfaceErrorOptions again{
            .sampling = ErrorSampling::Surface, .samples = samples, .seed = seed};
        EXPECT_LE(measure_error(cloud, found.cloud, again).max(), 0.04 * 1.02) << seed;
    }
}

/// A sphere with six limbs thinner than their points are apart.
PointCloud limbed_sphere() {
    std::mt19937 random(1);
    std::uniform_real_distribution<float> unit(0, 1);
    PointCloud cloud;
    for (int i = 0; i < 1'000; ++i) {
        const float z = 2 * unit(random) - 1, angle = 6.2831853F * unit(random);
        const float r = std::sqrt(1 - z * z);
        cloud.positions.emplace_back(r * std::cos(angle), r * std::sin(angle), z);
    }
    for (int i = 0; i < 500; ++i) {
        const float angle = 6.2831853F * unit(random), along = 1 + unit(random);
        Vec3f p;
        p[i % 3] = i % 6 < 3 ? along : -along;
        p[(i + 1) % 3] = 0.08F * std::cos(angle);
        p[(i + 2) % 3] = 0.08F * std::sin(angle);
        cloud.positions.push_back(p);
    }
    return cloud;
}

/// Finds the feet of some places on the surface of a cloud.
std::vector<Foot> feet_on(const PointCloud& cloud, const std::vector<Vec3f>& places) {
    const PointTree tree(cloud.positions, PointTree::Leaves::Compact, {});
    std::vector<Foot> feet(places.size());
    FootFinder(cloud.positions, tree, {})
        .find(places, [&](std::size_t i, const Foot& foot) { feet[i] = foot; }, {});
    return feet;
}

TEST(ErrorBounded, MostlyHoldsForWhoMeasuresByTheLetter) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    const PointCloud cloud = limbed_sphere();
    const PointCloud found = simplify_within_error(cloud, within(0.06, Method::Multiphase)).cloud;
    EXPECT_LT(found.size(), 1'000U);
    std::mt19937 random(5);
    std::normal_distribution<float> off(0, 0.03F);
    std::vector<Vec3f> starts, places;
    for (const Vec3f& p : found.positions)
        for (int i = 0; i < 50; ++i)
            starts.push_back(p + Vec3f(off(random), off(random), off(random)));
    for (const Foot& foot : feet_on(found, starts))
        if (foot.is_fixed()) places.push_back(foot.point.cast<float>());
    for (const Foot& foot : feet_on(cloud, places)) EXPECT_LE(foot.distance, 0.06 * 1.02);
    for (const Foot& foot : feet_on(found, cloud.positions)) EXPECT_LE(foot.distance, 0.06 * 1.02);
}

TEST(ErrorBounded, HasFewerPointsThanASnapshotThatHoldsEverywhere) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    const PointCloud cloud = bumpy_sphere(4'000);
    const SimplifyOptions options = within(0.015);
    const PointCloud found = simplify(cloud, options);
    const std::uint64_t more = found.size() * 6 / 5;
    EXPECT_GT(curve_of(cloud, options.method, {more}).front().error.max(), *options.max_error);
}

TEST(ErrorBounded, GivesTheInputBackWhereNothingSmallerHolds) {
    const PointCloud cloud = sphere(200);
    const ErrorBoundedCloud found = simplify_within_error(cloud, within(1e-9));
    EXPECT_TRUE(found.whole);
    EXPECT_EQ(found.cloud.positions, cloud.positions);
    EXPECT_EQ(found.error.max(), 0);
}

TEST(ErrorBounded, APartOfTheDiagonalIsThatManyInputUnits) {
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    const PointCloud cloud = sphere(500);
    SimplifyOptions options;
    options.max_error_rel = 0.03;
    const ErrorBoundedCloud found = simplify_within_error(cloud, options);
    EXPECT_DOUBLE_EQ(found.bound, 0.03 * bounds(cloud).diagonal());
    EXPECT_LE(found.error.max(), found.bound);
}

TEST(ErrorBounded, IsTheSameForAnyNumberOfThreadsWithAllAttributes) {
    const PointCloud cloud = test::with_attributes(bumpy_sphere(500));
    const ErrorBoundedCloud one =
        simplify_within_error(cloud, within(0.1), {.stop = {}, .progress = {}, .threads = 1});
    const ErrorBoundedCloud four =
        simplify_within_error(cloud, within(0.1), {.stop = {}, .progress = {}, .threads = 4});
    EXPECT_EQ(one.cloud.positions, four.cloud.positions);
    EXPECT_EQ(one.error.max(), four.error.max());
    EXPECT_EQ(one.cloud.attributes.size(), cloud.attributes.size());
    EXPECT_EQ(one.cloud.colors.size(), one.cloud.size());
    validate(one.cloud);
}

TEST(ErrorBounded, RefusesBoundsThatNoCloudCanKeep) {
    const PointCloud cloud = sphere(100);
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    for (const double bound : {0.0, -1.0, kInfinity, std::nan("")})
        test::expect_refused(": expected a finite number above 0",
                             [&] { simplify_within_error(cloud, within(bound)); });
    test::expect_refused("the cloud has no points", [&] { simplify_within_error({}, within(1)); });
    test::expect_refused("max_error: missing",
                         [&] { simplify_within_error(cloud, {.points = 10}); });
}

TEST(ErrorBounded, NamesTheMethodsThatHaveIt) {
    for (const Method method : {Method::Voxel, Method::Random, Method::Incremental}) {
        try {
            validate(within(1, method));
            ADD_FAILURE() << to_string(method);
        } catch (const Error& error) {
            EXPECT_NE(std::string(error.what()).find("multiphase, hierarchical, iterative"),
                      std::string::npos);
        }
    }
}

TEST(ErrorBounded, StopsWhenAsked) {
    std::stop_source source;
    source.request_stop();
    RunContext context;
    context.stop = source.get_token();
    EXPECT_THROW(simplify_within_error(sphere(1'000), within(0.1), context), Cancelled);
}

TEST(ErrorBounded, LooksAtPointsThatLieOffTheirOwnSurface) {
    const PointCloud cloud = sphere(4'000);
    constexpr double kBound = 0.06;
    ErrorBoundedCloud candidate;
    candidate.cloud = sphere(300);
    ErrorJudge judge(cloud, kBound, {});
    judge.watch(candidate.cloud);
    EXPECT_LE(judge.measure(candidate).max, ErrorJudge::kWithin);
    // The surface passes far below it, with twenty neighbours.
    candidate.cloud.positions[150] *= 1.08F;
    judge.watch(candidate.cloud);
    const ErrorJudge::Finding finding = judge.measure(candidate);
    EXPECT_LT(candidate.error.max(), kBound);
    EXPECT_NEAR(finding.max, 0.08 / kBound, 0.1);
    EXPECT_TRUE(std::ranges::any_of(finding.places, [&](const Vec3f& place) {
        return (place - candidate.cloud.positions[150]).norm() < 1e-4F;
    }));
}

TEST(ErrorBounded, KeepsFewPointsOfAWire) {
    // A catenary, within the bound of which straight lines between 30 points are.
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    constexpr std::size_t kPoints = 1'500;
    std::mt19937_64 random(2);
    std::uniform_real_distribution<double> along(-50, 50);
    PointCloud wire;
    for (std::size_t i = 0; i < kPoints; ++i) {
        const double x = along(random);
        wire.positions.push_back(Vec3d(x, 0, 40 * std::cosh(x / 40)).cast<float>());
    }
    for (const ErrorSampling sampling : {ErrorSampling::Points, ErrorSampling::Surface}) {
        const SurfaceErrorOptions options{.sampling = sampling};
        EXPECT_LT(measure_error(wire, wire, options).backward.max, 0.01);
    }
    const ErrorBoundedCloud found = simplify_within_error(wire, within(0.1));
    EXPECT_LT(found.cloud.size(), 400U);  // where the nearest points counted, all
    EXPECT_LT(measured_again(wire, found.cloud, ErrorSampling::Surface), 0.1);
}

TEST(ErrorBounded, KeepsBordersAndNeedsFewPointsForThem) {
    // A cylinder of radius 1 and height 2 that is open above and below.
    if (test::kSanitized) GTEST_SKIP() << "too slow under a sanitizer";
    constexpr double kBound = 0.05;
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> turn(0, 2 * std::numbers::pi), up(0, 2);
    PointCloud cylinder;
    for (std::size_t i = 0; i < 40'000; ++i) {
        const double angle = turn(random);
        cylinder.positions.push_back(
            Vec3d(std::cos(angle), std::sin(angle), up(random)).cast<float>());
    }
    for (const auto& [method, most] :
         {std::pair(Method::Multiphase, 650U), std::pair(Method::Hierarchical, 1'000U)}) {
        const PointCloud result = simplify_within_error(cylinder, within(kBound, method)).cloud;
        EXPECT_LT(result.size(), most) << to_string(method);
        for (const Vec3f& place : cylinder.positions) {
            if (std::abs(place.z() - 1) < 0.99F) continue;
            constexpr std::ptrdiff_t kAround = 96;
            std::vector<Eigen::Vector2f> around;  // on the unrolled surface
            for (const Vec3f& p : result.positions)
                around.emplace_back(std::atan2(place.x() * p.y() - place.y() * p.x(),
                                               place.x() * p.x() + place.y() * p.y()),
                                    p.z() - place.z());
            std::ranges::nth_element(around, around.begin() + kAround, {},
                                     [](const Eigen::Vector2f& way) { return way.squaredNorm(); });
            around.resize(kAround);
            EXPECT_LT(way_to_hull(around), kBound) << to_string(method);
        }
    }
}

TEST(ErrorBounded, DoesNotFailByAPointFarOff) {
    PointCloud cloud = sphere(600);
    cloud.positions[7] = {10, 0, 0};
    const ErrorBoundedCloud result = simplify_within_error(cloud, within(0.1));
    EXPECT_FALSE(result.whole);
    EXPECT_LT(result.cloud.size(), 200U);
    EXPECT_LT(measured_again(cloud, result.cloud, ErrorSampling::Surface), 0.1);
}

TEST(ErrorBounded, HasAResultForFewPoints) {
    PointCloud one, two;
    one.positions = {Vec3f(1, 2, 3)};
    two.positions = {Vec3f(0, 0, 0), Vec3f(1, 0, 0)};
    EXPECT_EQ(simplify_within_error(one, within(0.1)).cloud.size(), 1U);
    EXPECT_GE(simplify_within_error(two, within(0.1)).cloud.size(), 1U);
    EXPECT_GE(simplify_within_error(test::line(200), within(0.1)).cloud.size(), 2U);
}

TEST(ErrorCurve, FallsAsPointsGrow) {
    const PointCloud cloud = sphere(4'000);
    const auto counts = curve_counts(cloud.size(), 6);
    ASSERT_EQ(counts.size(), 6U);
    EXPECT_EQ(counts.front(), 2'000U);
    for (const Method method : kErrorBoundedMethods) {
        const auto curve = curve_of(cloud, method, {counts.rbegin(), counts.rend()});
        ASSERT_EQ(curve.size(), 6U);
        for (std::size_t i = 0; i < curve.size(); ++i) EXPECT_EQ(curve[i].points, counts[i]);
        EXPECT_LT(5 * curve.front().error.mean(), curve.back().error.mean()) << to_string(method);
    }
}

TEST(ErrorCurve, TakesTheCountsThatACloudHas) {
    EXPECT_EQ(curve_counts(100, {.points = {10, 50, 100, 1000}}),
              (std::vector<std::uint64_t>{50, 10}));
    test::expect_refused("points: the cloud has 10: expected at least one count below that",
                         [&] { curve_counts(10, {.points = {10}}); });
    test::expect_refused("count 65: expected at most 64", [&] { curve_counts(5'000, 65); });
    test::expect_refused("points 10: expected ascending counts", [&] {
        validate(ErrorCurveOptions{.points = {10, 10}});
    });
    test::expect_refused("count 1: expected 2..64",
                         [&] { validate(ErrorCurveOptions{.count = 1}); });
    test::expect_refused("target: a curve has none",
                         [&] { validate(ErrorCurveOptions{.simplification = {.ratio = 0.5}}); });
}

TEST(ErrorCurve, OfManyPointsBeginsWithAMillion) {
    EXPECT_EQ(curve_counts(1'000'000, 24).front(), 500'000U);
    const auto counts = curve_counts(300'000'000, 24);
    EXPECT_EQ(counts.size(), 24U);
    EXPECT_EQ(counts.front(), 1'000'000U);
    EXPECT_EQ(counts.back(), 300'000U);
    EXPECT_EQ(curve_counts(2'000'000'000, 24), std::vector<std::uint64_t>{2'000'000});
}

TEST(ErrorCurve, OfFewPointsWantsItsCountsGiven) {
    EXPECT_EQ(curve_counts(40, ErrorCurveOptions{}), std::vector<std::uint64_t>{20});
    EXPECT_EQ(curve_counts(39, {.points = {10}}), std::vector<std::uint64_t>{10});
    try {
        curve_counts(39, ErrorCurveOptions{});
        FAIL() << "39 points were accepted";
    } catch (const Error& error) {
        EXPECT_STREQ(error.what(),
                     "points: the cloud has 39: expected at least 40, or explicit counts");
    }
}

TEST(ErrorCurve, RefusesWhatHasNoCurve) {
    const auto refuses = [](const PointCloud& cloud, Method method,
                            const std::vector<std::uint64_t>& points, std::string_view part) {
        test::expect_error(ErrorCode::InvalidArgument, part,
                           [&] { curve_of(cloud, method, points); });
    };
    const PointCloud cloud = sphere(100);
    refuses(cloud, Method::Multiphase, {20, 10}, "points 10: expected ascending counts");
    refuses(cloud, Method::Multiphase, {0}, "points 0: expected ascending counts, each at least 1");
    refuses(cloud, Method::Multiphase, {100},
            "the cloud has 100: expected at least one count below");
    refuses(cloud, Method::Random, {10}, "method random: expected multiphase, hierarchical");
    refuses({}, Method::Multiphase, {10}, "the cloud has no points: expected at least 1");
}

}  // namespace
}  // namespace stipple
