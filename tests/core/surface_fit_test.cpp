#include "contraction/surface_fit.hpp"

#include "stipple/neighbors.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <vector>

namespace stipple {
namespace {

/// The numbers of the input points that are nearest to each of the points.
struct Shares {
    std::vector<Index> members, offsets;

    Shares(const std::vector<Vec3f>& points, const std::vector<Vec3f>& input) : offsets{0} {
        std::vector<std::vector<Index>> lists(points.size());
        const NeighborSearch search(points);
        for (Index i = 0; i < input.size(); ++i) {
            Neighbor nearest;
            search.nearest(input[i], {&nearest, 1});
            lists[nearest.index].push_back(i);
        }
        for (const auto& list : lists) {
            members.insert(members.end(), list.begin(), list.end());
            offsets.push_back(static_cast<Index>(members.size()));
        }
    }
    MemberLists lists() const { return {members.data(), offsets}; }
};

double mean_norm(const std::vector<Vec3f>& points) {
    double sum = 0;
    for (const Vec3f& p : points) sum += static_cast<double>(p.norm());
    return sum / static_cast<double>(points.size());
}

TEST(SurfaceFit, LeavesPointsOfAPlaneWhereTheyAre) {
    const auto input = test::plane(5000).positions;
    std::vector<Vec3f> points(input.begin(), input.begin() + 200);
    const std::vector<Vec3f> before = points;
    fit_surface(points, input, Shares(points, input).lists(), {.asked = 4}, {});
    for (std::size_t i = 0; i < points.size(); ++i)
        EXPECT_LT((points[i] - before[i]).norm(), 1e-6F);
}

TEST(SurfaceFit, BringsPointsBesideAPlaneToItStepByStep) {
    const auto input = test::plane(5000).positions;
    std::vector<Vec3f> points(input.begin(), input.begin() + 200);
    for (Vec3f& p : points) p.z() = 0.01F;
    const Shares shares(points, input);
    for (int step = 0; step < 10; ++step)
        fit_surface(points, input, shares.lists(), {.asked = 4}, {});
    double sum = 0;
    for (const Vec3f& p : points) {
        EXPECT_NEAR(p.z(), 0, 0.003);
        sum += static_cast<double>(std::abs(p.z()));
    }
    EXPECT_LT(sum / 200, 0.001);
}

TEST(SurfaceFit, MovesNoPointFartherThanItMay) {
    const auto input = test::plane(5000).positions;
    std::vector<Vec3f> points(input.begin(), input.begin() + 200);
    for (std::size_t i = 0; i < points.size(); ++i) points[i].z() = i % 3 == 0 ? 0.1F : 0.0F;
    const std::vector<Vec3f> before = points;
    constexpr float kFarthest = 0.05F;
    fit_surface(points, input, Shares(points, input).lists(), {.farthest_move = kFarthest}, {});
    std::size_t held = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        std::vector<float> distances;
        for (const Vec3f& p : before) distances.push_back((p - before[i]).norm());
        std::ranges::nth_element(distances, distances.begin() + 19);  // itself among them
        const float most = kFarthest * distances[19] / 3, moved = (points[i] - before[i]).norm();
        EXPECT_LT(moved, 1.001F * most);
        if (moved > 0.999F * most) ++held;
    }
    EXPECT_GT(held, 20U);
}

TEST(SurfaceFit, KeepsPointsOfTwoLayersAmidTheirMembers) {
    constexpr float kGap = 0.02F;
    const auto input = test::wall(20'000, kGap).positions;
    std::vector<Vec3f> points;  // five gaps apart on either side
    for (const float z : {0.0F, kGap})
        for (int x = 0; x < 10; ++x)
            for (int y = 0; y < 10; ++y)
                points.emplace_back(0.1F * static_cast<float>(x) + z, 0.1F * static_cast<float>(y),
                                    z);
    const std::vector<Vec3f> before = points;
    const auto far_apart = [](std::vector<Vec3f> sides) {
        for (Vec3f& p : sides) p.z() *= 100;
        return sides;
    };
    const Shares shares(far_apart(points), far_apart(input));
    for (int step = 0; step < 3; ++step) fit_surface(points, input, shares.lists(), {}, {});
    for (std::size_t i = 0; i < points.size(); ++i)
        EXPECT_NEAR(points[i].z(), before[i].z(), 0.1F * kGap);
}

/// The mean radius of 500 points of a sphere, fitted to more of it with so much noise.
double fitted_radius(double noise) {
    const auto input = test::sphere(20'000, noise).positions;
    std::vector<Vec3f> points = test::sphere(500).positions;
    const Shares shares(points, input);
    for (int step = 0; step < 6; ++step)
        fit_surface(points, input, shares.lists(), {.asked = 8}, {});
    return mean_norm(points);
}

// Of n points, 20 lie within r, n r^2 / 4 = 20, and h = r / 3.
constexpr double kSquaredH = 20 * 4.0 / 500 / 9;

// The linear surface through points at the radius 1 + d lies h^2 / 2 farther in, the quadratic one
// at 1 + d: the squares of both distances to the sphere are least where d = h^2 / 4.
TEST(SurfaceFit, OfANoisySphereComesToLieBetweenBothSurfaces) {
    EXPECT_NEAR(fitted_radius(0.03), 1 + kSquaredH / 4, 0.1 * kSquaredH);
}

TEST(SurfaceFit, StaysWhereTheQuadraticSurfaceIsCloseByFar) {
    EXPECT_NEAR(fitted_radius(0), 1, 0.05 * kSquaredH);
}

TEST(SurfaceFit, IsTheSameForEveryNumberOfThreads) {
    const auto input = test::sphere(40'000, 0.02).positions;
    std::vector<Vec3f> one(input.begin(), input.begin() + 4000);
    const Shares shares(one, input);
    std::vector<Vec3f> eight = one;
    RunContext context;
    context.threads = 1;
    fit_surface(one, input, shares.lists(), {.asked = 4}, context);
    context.threads = 8;
    fit_surface(eight, input, shares.lists(), {.asked = 4}, context);
    EXPECT_EQ(one, eight);
}

TEST(SurfaceFit, LeavesAloneWhatHasNoSurface) {
    const auto unchanged = [](std::vector<Vec3f> points) {
        std::vector<Index> offsets(points.size() + 1);
        std::vector<Index> members(points.size());
        for (Index i = 0; i < points.size(); ++i) offsets[i + 1] = (members[i] = i) + 1;
        const std::vector<Vec3f> before = points;
        fit_surface(points, before, {members.data(), offsets}, {.asked = 4}, {});
        return points == before;
    };
    EXPECT_TRUE(unchanged({}));
    EXPECT_TRUE(unchanged(test::sphere(19, 0.1).positions));
    EXPECT_TRUE(unchanged(test::line(100).positions));
    EXPECT_TRUE(unchanged(std::vector<Vec3f>(100, Vec3f(1, 2, 3))));
    EXPECT_FALSE(unchanged(test::sphere(100, 0.1).positions));
}

}  // namespace
}  // namespace stipple
