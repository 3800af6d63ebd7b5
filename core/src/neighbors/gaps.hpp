#pragma once

#include "base/distance_statistics.hpp"
#include "neighbors/point_tree.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <numeric>
#include <vector>

namespace stipple {

/// So many points tell a spacing.
constexpr std::size_t kAskedForGap = 256;

/// Distances from about `asked` of `count` points of a tree, point_at(i), to the nearest other.
template <typename PointAt>
std::vector<float> gaps(const PointTree& tree, std::size_t count, std::size_t asked,
                        PointAt&& point_at) {
    const std::size_t step = std::max<std::size_t>(1, count / asked);
    std::vector<float> gaps;
    for (std::size_t i = 0; i < count; i += step) {
        std::array<Neighbor, 2> room;
        gaps.push_back(std::sqrt(find_nearest(tree, point_at(i), room).back().distance_sq));
    }
    return gaps;
}

/// Their mean, of which no single one is much; 0 where most are.
template <typename PointAt>
double mean_gap(const PointTree& tree, std::size_t count, std::size_t asked, PointAt&& point_at) {
    std::vector<float> all = gaps(tree, count, asked, point_at);
    if (2 * std::ranges::count(all, 0.0F) > std::ssize(all)) return 0;
    limit_largest(all);
    return std::accumulate(all.begin(), all.end(), 0.0) / static_cast<double>(all.size());
}

/// The middle one of those of a tree's own points: a mean would be that of a few that lie far off.
inline double median_gap(const PointTree& tree) {
    std::vector<float> all =
        gaps(tree, tree.size(), kAskedForGap, [&](std::size_t i) { return tree.position(i); });
    const auto middle = all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2);
    std::ranges::nth_element(all, middle);
    return *middle;
}

}  // namespace stipple
