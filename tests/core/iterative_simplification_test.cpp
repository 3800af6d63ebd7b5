#include "stipple/iterative_simplification.hpp"

#include "analysis/tangent_plane.hpp"
#include "stipple/error.hpp"
#include "stipple/neighbors.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <set>
#include <tuple>

namespace stipple {
namespace {

using Options = IterativeSimplificationOptions;

RunContext on_threads(unsigned threads) {
    RunContext context;
    context.threads = threads;
    return context;
}

/// n points at random on the surface of the cube [0, 1]^3.
PointCloud cube_surface(std::size_t n) {
    std::mt19937 random(1);
    std::uniform_real_distribution<float> coordinate;
    PointCloud cloud;
    for (std::size_t i = 0; i < n; ++i) {
        Vec3f p(coordinate(random), coordinate(random), coordinate(random));
        p[static_cast<Eigen::Index>(i % 3)] = static_cast<float>(i / 3 % 2);
        cloud.positions.push_back(p);
    }
    return cloud;
}

/// An even grid of side x side points in the unit square, moved by a little chance.
PointCloud patch(std::size_t side) {
    std::mt19937 random(1);
    std::uniform_real_distribution<float> chance(-0.2F, 0.2F);
    PointCloud cloud;
    const auto at = [&](std::size_t i) {
        return std::clamp((static_cast<float>(i) + chance(random)) / static_cast<float>(side - 1),
                          0.0F, 1.0F);
    };
    for (std::size_t i = 0; i < side * side; ++i)
        cloud.positions.emplace_back(at(i % side), at(i / side), 0.0F);
    return cloud;
}

float nearest_distance(const PointCloud& cloud, const Vec3f& q) {
    float least = std::numeric_limits<float>::infinity();
    for (const Vec3f& p : cloud.positions) least = std::min(least, (p - q).norm());
    return least;
}

std::set<std::tuple<float, float, float>> as_set(const std::vector<Vec3f>& points) {
    std::set<std::tuple<float, float, float>> set;
    for (const Vec3f& p : points) set.emplace(p.x(), p.y(), p.z());
    return set;
}

TEST(IterativeSimplification, GivesEveryCountOfASmallCloud) {
    const PointCloud cloud = test::sphere(60, 0.1);
    for (const Placement placement : {Placement::Optimal, Placement::EndPoint}) {
        for (std::uint64_t size = 1; size <= 60; ++size) {
            const Options options{.target_size = size, .placement = placement};
            EXPECT_EQ(iterative_simplification(cloud, options).size(), size);
        }
    }
}

TEST(IterativeSimplification, LeavesACloudAloneThatIsSmallEnough) {
    const PointCloud cloud = test::with_attributes(test::sphere(60));
    for (const std::uint64_t size : {60U, 61U}) {
        const PointCloud result = iterative_simplification(cloud, {.target_size = size});
        EXPECT_EQ(result.positions, cloud.positions);
        EXPECT_EQ(result.colors, cloud.colors);
    }
}

TEST(IterativeSimplification, SnapshotsAreWhatSeparateRunsGive) {
    const PointCloud cloud = test::with_attributes(test::sphere(3000, 0.01));
    for (const Placement placement : {Placement::Optimal, Placement::EndPoint}) {
        const std::vector<std::uint64_t> sizes = {3000, 2999, 1700, 1699, 300, 300, 37, 1};
        std::size_t given = 0;
        iterative_snapshots(cloud, sizes, {.placement = placement}, [&](PointCloud&& snapshot) {
            const PointCloud alone = iterative_simplification(
                cloud, {.target_size = sizes[given++], .placement = placement});
            EXPECT_EQ(snapshot.positions, alone.positions);
            EXPECT_EQ(snapshot.normals, alone.normals);
            EXPECT_EQ(snapshot.colors, alone.colors);
        });
        EXPECT_EQ(given, sizes.size());
    }
}

TEST(IterativeSimplification, GivesTheSameBitsForAnyNumberOfThreads) {
    const PointCloud cloud = test::with_attributes(test::sphere(20'000, 0.01));
    const Options options{.target_size = 500, .max_displacement = 0.001, .color_weight = 0.01};
    const PointCloud one = iterative_simplification(cloud, options, on_threads(1));
    const PointCloud eight = iterative_simplification(cloud, options, on_threads(8));
    EXPECT_EQ(one.positions, eight.positions);
    EXPECT_EQ(one.colors, eight.colors);
}

TEST(IterativeSimplification, KeepsPointsOfAPlaneInIt) {
    for (const Vec3f& p :
         iterative_simplification(test::plane(2000), {.target_size = 100}).positions) {
        EXPECT_NEAR(p.z(), 0, 1e-6);
        EXPECT_NEAR(p.x(), 0.5, 0.52);
        EXPECT_NEAR(p.y(), 0.5, 0.52);
    }
}

TEST(IterativeSimplification, SpreadsThePointsOfAPlaneEvenly) {
    const PointCloud result = iterative_simplification(patch(100), {.target_size = 400});
    double sum = 0, squares = 0;
    for (const Vec3f& p : result.positions) {
        double least = 1;
        for (const Vec3f& q : result.positions)
            if (q != p) least = std::min(least, static_cast<double>((q - p).norm()));
        sum += least;
        squares += least * least;
    }
    const double mean = sum / 400, variation = std::sqrt(squares / 400 - mean * mean) / mean;
    EXPECT_NEAR(mean, 0.05, 0.01);  // 400 points in the unit square
    EXPECT_LT(variation, 0.2);      // of points at random: 0.52
}

TEST(IterativeSimplification, DoesNotShrinkAPatchByMoreThanAPartOfItsSpacing) {
    Aabb box;
    const PointCloud result = iterative_simplification(patch(100), {.target_size = 400});
    const Aabb b = bounds(result);
    EXPECT_LT(b.min.x(), 0.01);  // half the spacing is 0.025
    EXPECT_LT(b.min.y(), 0.01);
    EXPECT_GT(b.max.x(), 0.99);
    EXPECT_GT(b.max.y(), 0.99);
}

TEST(IterativeSimplification, LeavesPointsOffAllSurfacesWhereTheyAre) {
    PointCloud cloud = test::sphere(20'000, 0.001);
    std::vector<Vec3f> strays;
    for (const Vec3f& p : test::sphere(10).positions) strays.push_back(1'000 * p);
    cloud.positions.insert(cloud.positions.end(), strays.begin(), strays.end());
    for (const std::uint64_t count : {20'009ULL, 5'000ULL, 500ULL}) {
        const PointCloud result = iterative_simplification(cloud, {.target_size = count});
        for (const Vec3f& stray : strays) {
            EXPECT_TRUE(std::ranges::any_of(result.positions, [&](const Vec3f& p) {
                return (p - stray).norm() < 1e-2F;
            })) << count;
        }
    }
}

TEST(IterativeSimplification, KeepsPointsOfALineOnIt) {
    const PointCloud cloud = test::line(500);
    const Vec3f direction = (cloud.positions.back() - cloud.positions.front()).normalized();
    for (const Vec3f& p : iterative_simplification(cloud, {.target_size = 20}).positions)
        EXPECT_NEAR((p - cloud.positions.front()).cross(direction).norm(), 0, 1e-3);
}

TEST(IterativeSimplification, FindsTheCornersOfACube) {
    const PointCloud cloud = cube_surface(20'000);
    const PointCloud result = iterative_simplification(cloud, {.target_size = 150});
    for (int corner = 0; corner < 8; ++corner) {
        const Vec3f at(static_cast<float>(corner & 1), static_cast<float>(corner >> 1 & 1),
                       static_cast<float>(corner >> 2));
        EXPECT_LT(nearest_distance(result, at), 0.07F);  // their spacing is 0.2
    }
}

TEST(IterativeSimplification, PutsMorePointsWhereTheSurfaceBends) {
    PointCloud cloud = test::plane(8000);
    for (Vec3f& p : cloud.positions)
        if (p.x() > 0.5F) p.z() = 0.05F * std::sin(25 * (p.x() - 0.5F)) * std::sin(25 * p.y());
    const auto result = iterative_simplification(cloud, {.target_size = 400}).positions;
    const auto flat = std::ranges::count_if(result, [](const Vec3f& p) { return p.x() < 0.5F; });
    EXPECT_LT(flat, 120);
    EXPECT_GT(flat, 10);
}

TEST(IterativeSimplification, PutsThePointsOfASphereOutsideSoThatItDoesNotShrink) {
    const PointCloud result = iterative_simplification(test::sphere(20'000), {.target_size = 200});
    double sum = 0;
    for (const Vec3f& p : result.positions) sum += static_cast<double>(p.norm());
    // A linear moving least squares surface lies h^2 / 2 inside of its points, h^2 = r^2 / 9 and
    // 20 of the points within r, and a quadratic one does not: half way is as far as they may go.
    const double h_sq = 20 * 4.0 / 200 / 9;
    EXPECT_GT(sum / 200, 1);
    EXPECT_LT(sum / 200, 1 + h_sq / 4);
}

TEST(IterativeSimplification, KeepsPointsAsNearToTheSurfaceAsAskedFor) {
    const PointCloud cloud = test::sphere(20'000);
    for (const double limit : {0.0, 0.002}) {
        const PointCloud result =
            iterative_simplification(cloud, {.target_size = 200, .max_displacement = limit});
        for (const Vec3f& p : result.positions) EXPECT_NEAR(p.norm(), 1, limit + 2e-4);
    }
}

TEST(IterativeSimplification, KeepsPointsAsNearToTheSurfaceAtEdgesAsAskedFor) {
    PointCloud cube = test::plane(30'000);  // the surface of [0, 1]^3
    for (std::size_t i = 0; i < cube.size(); ++i) {
        const Vec3f p = cube.positions[i];
        Vec3f& q = cube.positions[i];
        for (int axis = 0; axis < 3; ++axis) q[(axis + static_cast<int>(i % 3)) % 3] = p[axis];
        if (i % 2 == 0) q = Vec3f::Ones() - q;
    }
    for (const double limit : {0.0, 0.001, 0.005}) {
        const PointCloud result =
            iterative_simplification(cube, {.target_size = 600, .max_displacement = limit});
        for (const Vec3f& p : result.positions) {
            const Vec3f from_middle = (p - Vec3f::Constant(0.5F)).cwiseAbs();
            EXPECT_NEAR(from_middle.maxCoeff(), 0.5, limit + 1e-3) << limit;
        }
    }
}

/// How far a point is from the tangent plane of the input point nearest to it.
double off_plane(const Vec3f& p, const PointCloud& input, const NeighborSearch& search) {
    std::array<Neighbor, 16> room;
    const Index nearest = search.nearest(p, std::span(room).first(1))[0].index;
    std::vector<Vec3d> around;
    for (const Neighbor& neighbor : search.nearest(input.positions[nearest], room))
        if (neighbor.index != nearest)
            around.push_back(
                (input.positions[neighbor.index] - input.positions[nearest]).cast<double>());
    return std::abs(normal_from(around).dot((p - input.positions[nearest]).cast<double>()));
}

TEST(IterativeSimplification, KeepsPointsAsNearToThePlanesOfAScanAsAskedFor) {
    const PointCloud cloud = test::sphere(20'000, 0.01);
    const NeighborSearch search(cloud.positions);
    for (const double limit : {0.0, 0.002}) {
        const PointCloud result =
            iterative_simplification(cloud, {.target_size = 1'000, .max_displacement = limit});
        for (const Vec3f& p : result.positions)
            EXPECT_LE(off_plane(p, cloud, search), limit + 1e-6);
    }
}

TEST(IterativeSimplification, WithEndPointsIsASubsetAndLevelsAreNested) {
    const PointCloud cloud = test::with_attributes(test::sphere(5000, 0.01));
    std::set<std::tuple<float, float, float>> finer = as_set(cloud.positions);
    const std::vector<std::uint64_t> sizes = {2000, 500, 20};
    iterative_snapshots(cloud, sizes, {.placement = Placement::EndPoint}, [&](PointCloud&& level) {
        const auto coarser = as_set(level.positions);
        EXPECT_TRUE(std::ranges::includes(finer, coarser));
        finer = coarser;
        const auto& height = std::get<std::vector<float>>(level.attributes[0].values);
        for (std::size_t i = 0; i < level.size(); ++i) EXPECT_EQ(height[i], level.positions[i].z());
    });
}

TEST(IterativeSimplification, KeepsEveryAttribute) {
    const PointCloud cloud = test::with_attributes(test::sphere(5000));
    const PointCloud result = iterative_simplification(cloud, {.target_size = 300});
    validate(result);
    ASSERT_EQ(result.normals.size(), 300U);
    ASSERT_EQ(result.colors.size(), 300U);
    ASSERT_EQ(result.attributes.size(), 2U);
    const auto& height = std::get<std::vector<float>>(result.attributes[0].values);
    for (std::size_t i = 0; i < 300; ++i) {
        EXPECT_NEAR(height[i], result.positions[i].z(), 0.05);
        EXPECT_GT(result.normals[i].dot(result.positions[i].normalized()), 0.99F);
    }
}

TEST(IterativeSimplification, KeepsPointsAtAnEdgeOfColorsAndFewThatMixThem) {
    PointCloud cloud = patch(100);
    const auto is_red = [](const Vec3f& p) { return p.x() < 0.53F; };
    for (const Vec3f& p : cloud.positions)
        cloud.colors.push_back(is_red(p) ? Rgba8{255, 0, 0, 255} : Rgba8{0, 0, 255, 255});
    const auto count = [&](double weight) {
        const PointCloud result =
            iterative_simplification(cloud, {.target_size = 300, .color_weight = weight});
        std::pair<int, int> near_and_mixed;
        for (std::size_t i = 0; i < result.size(); ++i) {
            near_and_mixed.first += std::abs(result.positions[i].x() - 0.53F) < 0.03F;
            near_and_mixed.second += result.colors[i].r > 0 && result.colors[i].b > 0;
        }
        return near_and_mixed;
    };
    const auto [near_without, mixed_without] = count(0);
    const auto [near_with, mixed_with] = count(1);
    EXPECT_GT(near_with, 2 * near_without);
    EXPECT_LT(4 * mixed_with, mixed_without);
}

TEST(IterativeSimplification, KeepsPointsWhereAnAttributeChanges) {
    PointCloud cloud = patch(100);
    std::vector<double> values;
    for (const Vec3f& p : cloud.positions) values.push_back(p.y() < 0.3F ? -1e300 : 1e300);
    cloud.attributes.push_back({"step", values, 1, Reduction::Mean});
    const auto near = [&](double weight) {
        const PointCloud result = iterative_simplification(
            cloud, {.target_size = 300, .attribute_weights = {{"step", weight}}});
        return std::ranges::count_if(result.positions,
                                     [](const Vec3f& p) { return std::abs(p.y() - 0.3F) < 0.03F; });
    };
    EXPECT_GT(near(0.05), 2 * near(0));
}

TEST(IterativeSimplification, JoinsPartsThatAreApartWhenNothingElseIsLeft) {
    PointCloud cloud;
    for (int part = 0; part < 6; ++part)
        for (int i = 0; i < 40; ++i)
            cloud.positions.emplace_back(static_cast<float>(1000 * part), static_cast<float>(i % 8),
                                         static_cast<float>(i / 8));
    const auto six = iterative_simplification(cloud, {.target_size = 6}).positions;
    std::set<int> parts;
    for (const Vec3f& p : six) parts.insert(static_cast<int>(std::lround(p.x() / 1000)));
    EXPECT_EQ(parts.size(), 6U);
    for (const std::uint64_t size : {1U, 2U, 5U})
        EXPECT_EQ(iterative_simplification(cloud, {.target_size = size}).size(), size);
}

TEST(IterativeSimplification, IsTheSameInEveryUnitHoweverSmallOrLarge) {
    const PointCloud cloud = test::sphere(2000, 0.01);
    const auto expected = iterative_simplification(cloud, {.target_size = 100}).positions;
    for (const int exponent : {-100, -20, 20, 100}) {
        PointCloud scaled = cloud;
        const float scale = std::ldexp(1.0F, exponent);
        for (Vec3f& p : scaled.positions) p *= scale;
        auto result = iterative_simplification(scaled, {.target_size = 100}).positions;
        for (Vec3f& p : result) p /= scale;
        EXPECT_EQ(result, expected) << exponent;
    }
}

TEST(IterativeSimplification, TakesPointsThatAreAllAlike) {
    PointCloud cloud;
    cloud.positions.assign(50, Vec3f(1, 2, 3));
    const auto result = iterative_simplification(cloud, {.target_size = 7}).positions;
    EXPECT_EQ(result, std::vector<Vec3f>(7, Vec3f(1, 2, 3)));
}

TEST(IterativeSimplification, SaysWhatIsWrongWithAnOption) {
    const PointCloud cloud = test::with_attributes(test::sphere(20));
    const auto message = [&](const Options& options, const PointCloud& of) {
        try {
            iterative_simplification(of, options);
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ErrorCode::InvalidArgument);
            return std::string(error.what());
        }
        return std::string("no error");
    };
    EXPECT_EQ(message({}, cloud), "target_size 0: expected at least 1");
    EXPECT_EQ(message({.target_size = 5}, {}), "the cloud has no points");
    EXPECT_EQ(message({.target_size = 5, .k = 2}, cloud), "k 2: expected 3..32");
    EXPECT_EQ(message({.target_size = 5, .k = 33}, cloud), "k 33: expected 3..32");
    EXPECT_EQ(message({.target_size = 5, .max_displacement = -0.5}, cloud),
              "max_displacement -0.5: expected a finite number, at least 0");
    EXPECT_EQ(message({.target_size = 5, .color_weight = std::nan("")}, cloud),
              "color_weight nan: expected a finite number, at least 0");
    EXPECT_EQ(message({.target_size = 5, .color_weight = 1}, test::sphere(20)),
              "color_weight: the cloud has no colours; omit it");
    EXPECT_EQ(message({.target_size = 5, .attribute_weights = {{"heat", 1}}}, cloud),
              "attribute_weights: the cloud has no attribute heat");
    const auto snapshots = [&](std::vector<std::uint64_t> sizes) {
        iterative_snapshots(cloud, sizes, {}, [](PointCloud&&) {});
    };
    test::expect_refused("size 21: expected 1..20, descending", [&] { snapshots({21}); });
    test::expect_refused("size 6: expected 1..5, descending", [&] { snapshots({5, 6}); });
    test::expect_refused("size 0: expected 1..5, descending", [&] { snapshots({5, 0}); });
}

TEST(IterativeSimplification, TellsItsProgressAllAlong) {
    const PointCloud cloud = test::sphere(20'000);
    for (const std::vector<std::uint64_t>& sizes :
         {std::vector<std::uint64_t>{5000}, {2000, 500, 20}}) {
        double last = 0;
        const auto tell = [&](double fraction) {
            EXPECT_GE(fraction, last);
            EXPECT_LT(fraction, last + 0.2) << "of " << sizes[0];
            last = fraction;
        };
        iterative_snapshots(cloud, sizes, {}, [](PointCloud&&) {}, {.progress = tell});
        EXPECT_GT(last, 0.8);
    }
}

TEST(IterativeSimplification, StopsWhenAskedTo) {
    std::stop_source source;
    RunContext context;
    context.stop = source.get_token();
    context.progress = [&](double fraction) {
        if (fraction > 0.2) source.request_stop();
    };
    EXPECT_THROW(iterative_simplification(test::sphere(20'000), {.target_size = 10}, context),
                 Cancelled);
}

}  // namespace
}  // namespace stipple
