#include "base/kernel_sets.hpp"
#include "stipple/error.hpp"
#include "stipple/neighbors.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <thread>

namespace stipple {
namespace {

/// Every point as seen from q, sorted.
std::vector<Neighbor> all_from(const std::vector<Vec3f>& points, const Vec3f& q) {
    std::vector<Neighbor> all;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Vec3f d = points[i] - q;
        all.push_back({d.x() * d.x() + d.y() * d.y() + d.z() * d.z(), static_cast<Index>(i)});
    }
    std::ranges::sort(all);
    return all;
}

/// Positions on, near and far from the points.
std::vector<Vec3f> positions_about(const std::vector<Vec3f>& points) {
    std::vector<Vec3f> positions;
    for (const Vec3f& p : test::cube(60).positions) positions.push_back(2.0F * p);
    for (const Vec3f& p : test::cube(5).positions) positions.push_back(1000.0F * p);
    for (std::size_t i = 0; i < points.size(); i += 1 + points.size() / 60)
        positions.push_back(points[i]);
    return positions;
}

void expect_exact(const std::vector<Vec3f>& points) {
    const NeighborSearch search(points);
    ASSERT_EQ(search.size(), points.size());
    for (const Vec3f& q : positions_about(points)) {
        const std::vector<Neighbor> all = all_from(points, q);
        for (const std::size_t k : {1, 2, 7, 20, 64, 300}) {
            std::vector<Neighbor> room(k);
            const std::span<Neighbor> found = search.nearest(q, room);
            ASSERT_EQ(found.size(), std::min(k, points.size()));
            ASSERT_TRUE(std::ranges::equal(found, std::span(all).first(found.size())));
        }
        for (const float radius : {0.0F, 0.1F, 1.0F, 5000.0F}) {
            std::vector<Neighbor> found(3), expected;
            search.within(q, radius, found);
            std::ranges::sort(found);
            std::ranges::copy_if(all, std::back_inserter(expected), [&](const Neighbor& n) {
                return n.distance_sq <= radius * radius;
            });
            ASSERT_EQ(found, expected);
        }
    }
}

TEST(NeighborSearch, IsExactOnASurface) {
    expect_exact(test::sphere(1500, 0.05).positions);
}
TEST(NeighborSearch, IsExactInAVolume) {
    expect_exact(test::cube(1200).positions);
}
TEST(NeighborSearch, IsExactOnALine) {
    expect_exact(test::line(700).positions);
}
TEST(NeighborSearch, FindsTheSmallerIndexAmongEquals) {
    expect_exact(std::vector<Vec3f>(300, Vec3f(1, 0, 1)));
}
TEST(NeighborSearch, FindsAllOfATinyCloud) {
    for (std::size_t n = 0; n < 20; ++n) expect_exact(test::cube(n).positions);
}
TEST(NeighborSearch, IsExactAcrossDensitiesAndOutliers) {
    std::vector<Vec3f> points = test::cube(400).positions;
    for (const Vec3f& p : test::cube(400, 2).positions)
        points.push_back(p * 1e-6F + Vec3f(100, 0, 0));
    for (const Vec3f& p : test::cube(5, 3).positions) points.push_back(p * 1e18F);
    expect_exact(points);
}
TEST(NeighborSearch, IsExactFromWhereMostPointsAreEquallyFar) {
    std::vector<Vec3f> points;
    for (const Vec3f& p : test::cube(1500).positions)
        points.push_back((p * 4.0F).array().round() * 1e-7F);
    expect_exact(points);
}
TEST(NeighborSearch, IsExactWhereSquaredDistancesUnderflowOrOverflow) {
    std::vector<Vec3f> points;
    for (const Vec3f& p : test::cube(100).positions) points.push_back(p * 1e-22F);
    for (const Vec3f& p : test::cube(40, 2).positions) points.push_back(p * 3e38F);
    expect_exact(points);
}

TEST(NeighborSearch, FindsNothingWithinARadiusThatIsNone) {
    const NeighborSearch search(test::cube(30).positions);
    std::vector<Neighbor> found(1);
    for (const float radius : {-1.0F, NAN}) {
        search.within(Vec3f::Zero(), radius, found);
        EXPECT_TRUE(found.empty());
    }
}

TEST(NeighborSearch, AnswersManyThreadsAtOnce) {
    const std::vector<Vec3f> points = test::sphere(5000).positions;
    const NeighborSearch search(points);
    std::vector<std::vector<Neighbor>> answers(4);
    {
        std::vector<std::jthread> threads;
        for (auto& answer : answers) {
            threads.emplace_back([&] {
                std::array<Neighbor, 10> room;
                for (const Vec3f& p : points) {
                    const auto found = search.nearest(p, room);
                    answer.insert(answer.end(), found.begin(), found.end());
                }
            });
        }
    }
    for (const auto& answer : answers) EXPECT_EQ(answer, answers.front());
}

TEST(NeighborSearch, GivesTheSameAnswersWithThePlainKernels) {
    const PointCloud cloud = test::sphere(2500, 0.05);
    const NeighborSearch search(cloud.positions);
    for (const Vec3f& q : test::cube(50).positions) {
        for (const std::size_t k : {1U, 2U, 5U, 16U, 64U}) {
            std::vector<Neighbor> quick(k), plain(k);
            search.nearest(q, quick);
            const PlainKernelsOnly plain_only;
            search.nearest(q, plain);
            EXPECT_EQ(quick, plain);
        }
    }
}

}  // namespace
}  // namespace stipple
