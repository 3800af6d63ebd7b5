#include "clustering/region_growing.hpp"

#include "base/random.hpp"
#include "clustering/stray_points.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <span>

namespace stipple {
namespace {

using Region2 = std::set<Index>;

/// Eq. 5 of the first `count` points.
double variation_of(const std::vector<Vec3f>& points,
                    const std::vector<std::pair<float, Index>>& chosen, std::size_t count) {
    Vec3d mean = Vec3d::Zero();
    for (std::size_t i = 0; i < count; ++i) mean += points[chosen[i].second].cast<double>();
    mean /= static_cast<double>(count);
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < count; ++i) {
        const Vec3d d = points[chosen[i].second].cast<double>() - mean;
        covariance += d * d.transpose();
    }
    const Vec3d values = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvalues();
    return values.sum() > 0 ? std::max(0.0, values[0]) / values.sum() : 0.0;
}

using Distances = std::vector<std::pair<float, Index>>;

/// Of points in order of distance, how many are in the rings up to the last at which the bound
/// holds.
std::size_t within_rings(const std::vector<Vec3f>& points, const Distances& chosen, double bound) {
    const auto up_to = [&](int rings) {
        const double farthest = static_cast<double>(chosen.back().first);
        return static_cast<std::size_t>(std::ranges::count_if(chosen, [&](const auto& d) {
            return static_cast<double>(d.first) / farthest * 16 < rings;
        }));
    };
    for (int rings = 15; rings > 0; --rings) {
        const std::size_t size = up_to(rings);
        if (variation_of(points, chosen, size) <= bound) return size;
    }
    std::size_t size = up_to(1);
    while (variation_of(points, chosen, size) > bound) --size;
    return size;
}

/// The rule of the header by sorting all points for every region.
std::vector<Region2> regions_by_sorting(const std::vector<Vec3f>& points,
                                        const RegionBounds& bounds, std::uint64_t seed_number) {
    const PointBlocks blocks = blocks_for_regions(points, bounds, {});
    const std::span order(blocks.samples().index, points.size());
    const bool bounded = std::isfinite(bounds.max_variation);
    std::vector<Region2> regions;
    std::vector<char> taken(points.size());
    std::size_t left = points.size();
    std::size_t size = bounded ? std::min<std::size_t>(8, bounds.max_size) : bounds.max_size;
    Index seed = order[below(random_bits(seed_number, 0), points.size())];
    double spacing = -1;
    while (true) {
        Distances nearest, chosen;
        for (Index i = 0; i < points.size(); ++i)
            nearest.emplace_back((points[i] - points[seed]).squaredNorm(), i);
        std::ranges::sort(nearest);
        const double root = std::sqrt(static_cast<double>(size));
        const double full = std::sqrt(nearest[size - 1].first);
        const bool is_full = spacing < 0 || full < 2 * spacing * root;
        const double radius = is_full ? full : 2 * spacing * root;
        spacing = is_full ? full / root : 1.25 * spacing;
        for (const auto& [distance_sq, i] : nearest) {
            if (chosen.size() == size || std::sqrt(distance_sq) > 1.3 * radius) break;
            if (taken[i] == 0) chosen.emplace_back(distance_sq, i);
        }
        std::size_t kept = chosen.size();
        if (bounded && variation_of(points, chosen, kept) > bounds.max_variation)
            kept = within_rings(points, chosen, bounds.max_variation);
        if (bounded && kept == size && size < bounds.max_size) {
            size = std::min<std::size_t>(4 * size, bounds.max_size);
            continue;
        }
        const bool is_bent = kept < chosen.size();
        const double own_radius = is_bent ? std::sqrt(chosen[kept - 1].first) : radius;
        if (is_bent) {
            size = std::clamp<std::size_t>(2 * kept, std::min<std::size_t>(8, bounds.max_size),
                                           bounds.max_size);
        }
        chosen.resize(kept);
        Region2 region;
        for (const auto& [distance_sq, i] : chosen) {
            taken[i] = 1;
            region.insert(i);
        }
        left -= kept;
        regions.push_back(std::move(region));
        if (left == 0) return regions;
        seed = *std::ranges::find_if(order, [&](Index i) { return taken[i] == 0; });
        double least_miss = std::numeric_limits<double>::infinity();
        for (const auto& [distance_sq, i] : nearest) {
            if (taken[i] != 0 || std::sqrt(distance_sq) > 1.85 * radius) continue;
            const double miss = std::abs(distance_sq - 1.75 * 1.75 * own_radius * own_radius);
            if (miss < least_miss) seed = i;
            least_miss = std::min(miss, least_miss);
        }
    }
}

Regions grown_from(const std::vector<Vec3f>& points, const RegionBounds& bounds, std::uint64_t seed,
                   const RunContext& context = {}) {
    PointBlocks blocks = blocks_for_regions(points, bounds, context);
    return grow_regions(blocks, bounds, seed, context);
}

std::vector<Region2> as_sets(const Regions& regions) {
    std::vector<Region2> sets;
    for (const Region& region : regions.regions) {
        sets.emplace_back(regions.members.begin() + region.begin,
                          regions.members.begin() + region.end);
    }
    return sets;
}

std::vector<Vec3f> scaled(std::vector<Vec3f> points, float by) {
    for (Vec3f& p : points) p *= by;
    return points;
}

/// A dense and a sparse sphere, and points far from both.
std::vector<Vec3f> uneven() {
    std::vector<Vec3f> points = test::sphere(600, 0.02).positions;
    for (const Vec3f& p : test::sphere(100, 0.02, 2).positions)
        points.push_back(p * 2.0F + Vec3f(5, 0, 0));
    for (const Vec3f& p : test::cube(12).positions) points.push_back(p * 300.0F);
    return points;
}

TEST(RegionGrowing, IsTheRuleThatSortingAllPointsGives) {
    for (const auto& points : {test::sphere(700, 0.01).positions, test::cube(500).positions,
                               test::plane(600).positions, uneven()}) {
        for (const std::size_t max_size : {1U, 2U, 7U, 40U, 300U}) {
            EXPECT_EQ(as_sets(grown_from(points, {.max_size = max_size}, 3)),
                      regions_by_sorting(points, {.max_size = max_size}, 3))
                << points.size() << " points, at most " << max_size;
        }
    }
}

TEST(RegionGrowing, UnderABoundOnTheVariationIsThatRule) {
    for (const auto& points : {test::sphere(700, 0.01).positions, test::cube(400).positions}) {
        for (const std::size_t max_size : {5U, 40U, 300U}) {
            for (const double bound : {0.004, 0.05}) {
                const RegionBounds bounds = {.max_size = max_size, .max_variation = bound};
                EXPECT_EQ(as_sets(grown_from(points, bounds, 3)),
                          regions_by_sorting(points, bounds, 3))
                    << points.size() << " points, at most " << max_size << ", within " << bound;
            }
        }
    }
}

TEST(RegionGrowing, DoesNotDependOnTheUnit) {
    const auto points = uneven();
    const auto regions = as_sets(grown_from(points, {.max_size = 20}, 1));
    for (const float unit : {0x1p-110F, 0x1p-20F, 0x1p+115F})
        EXPECT_EQ(as_sets(grown_from(scaled(points, unit), {.max_size = 20}, 1)), regions) << unit;
}

TEST(RegionGrowing, ABoundOnTheVariationHoldsForEveryRegion) {
    const auto points = test::sphere(4000, 0.03).positions;
    for (const double bound : {0.001, 0.01, 0.1}) {
        const Regions regions =
            grown_from(points, {.max_size = points.size(), .max_variation = bound}, 1);
        std::size_t members = 0;
        for (const Region& region : regions.regions) {
            EXPECT_LE(region.variation, bound * (1 + 1e-9));
            members += region.size();
        }
        EXPECT_EQ(members, points.size());
    }
}

TEST(RegionGrowing, APlaneDoesNotVarySoNothingEndsARegion) {
    const auto points = test::plane(2000).positions;
    const Regions regions =
        grown_from(points, {.max_size = points.size(), .max_variation = 0.01}, 1);
    std::size_t largest = 0;
    for (const Region& region : regions.regions)
        largest = std::max<std::size_t>(largest, region.size());
    EXPECT_GT(largest, points.size() / 2);
}

/// Whether the regions have every point once.
bool are_all_points(const Regions& regions, std::size_t n) {
    std::vector<Index> members = regions.members, all(n);
    std::ranges::sort(members);
    std::iota(all.begin(), all.end(), Index{0});
    return members == all && regions.regions.back().end == n;
}

TEST(RegionGrowing, InPartsDoesNotDependOnTheNumberOfThreads) {
    const auto points = test::sphere(60'000, 0.01).positions;
    for (const double bound : {0.01, std::numeric_limits<double>::infinity()}) {
        const RegionBounds bounds = {.max_size = 8, .max_variation = bound};
        const Regions one = grown_from(points, bounds, 1, {.threads = 1});
        const Regions four = grown_from(points, bounds, 1, {.threads = 4});
        EXPECT_EQ(one.members, four.members);
        EXPECT_TRUE(are_all_points(one, points.size()));
    }
}

TEST(RegionGrowing, InPartsIsAsEvenAsInOne) {
    const auto share_of_full = [](const std::vector<Vec3f>& points) {
        const Regions regions = grown_from(points, {.max_size = 16}, 1);
        std::size_t full = 0;
        for (const Region& region : regions.regions) full += region.size() == 16 ? 16 : 0;
        return static_cast<double>(full) / static_cast<double>(points.size());
    };
    const double in_parts = share_of_full(test::sphere(16 * 4'100).positions);
    const double in_one = share_of_full(test::sphere(16 * 4'090).positions);
    EXPECT_NEAR(in_parts, in_one, 0.02);
}

TEST(RegionGrowing, AsManyAsEstimatedWhereAllAreAlike) {
    const auto points = test::sphere(40'000).positions;
    const RegionBounds bounds = {.max_size = 40};
    PointBlocks blocks = blocks_for_regions(points, bounds, {});
    EXPECT_NEAR(estimated_regions(blocks, bounds, {}), 1000, 20);
    EXPECT_EQ(as_sets(grow_regions(blocks, bounds, 1, {})), as_sets(grown_from(points, bounds, 1)))
        << "an estimate takes no point";
}

TEST(StrayPoints, GoToTheClosestCentroid) {
    for (const auto& points : {test::sphere(3000, 0.02).positions, uneven()}) {
        const Regions regions = grown_from(points, {.max_size = 25}, 1);
        std::vector<Index> chosen;
        for (Index i = 0; i < regions.regions.size(); ++i) {
            if (regions.regions[i].size() >= 20) chosen.push_back(i);
        }
        std::vector<Index> expected(points.size());
        for (Index r = 0; r < regions.regions.size(); ++r) {
            const Region& region = regions.regions[r];
            const auto own = std::ranges::find(chosen, r);
            for (Index at = region.begin; at < region.end; ++at) {
                const Vec3f p = points[regions.members[at]] * regions.scale;
                const auto distance_sq = [&](Index c) {
                    return (regions.regions[c].centroid - p).squaredNorm();
                };
                const auto to =
                    own != chosen.end() ? own : std::ranges::min_element(chosen, {}, distance_sq);
                expected[regions.members[at]] = static_cast<Index>(to - chosen.begin());
            }
        }
        const Clusters clusters = with_strays_joined(points, regions, chosen, {});
        ASSERT_EQ(clusters.size(), chosen.size());
        ASSERT_EQ(clusters.members.size(), points.size());
        for (std::size_t c = 0; c < clusters.size(); ++c) {
            for (const Index i : clusters.of(c)) EXPECT_EQ(expected[i], c);
        }
    }
}

TEST(StrayPoints, AllGoToTheOnlyCluster) {
    const auto points = test::cube(500).positions;
    const Regions regions = grown_from(points, {.max_size = 9}, 1);
    const std::vector<Index> chosen = {3};
    const Clusters clusters = with_strays_joined(points, regions, chosen, {});
    EXPECT_EQ(clusters.size(), 1U);
    EXPECT_EQ(std::set<Index>(clusters.members.begin(), clusters.members.end()).size(), 500U);
}

}  // namespace
}  // namespace stipple
