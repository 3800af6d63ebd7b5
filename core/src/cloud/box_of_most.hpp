#pragma once

#include "stipple/point_cloud.hpp"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace stipple {

/// About a thousand of n points, evenly spread, without those that are not finite.
template <typename PointAt>
std::vector<Vec3d> some_of(std::size_t n, PointAt&& point_at) {
    constexpr std::size_t kSome = 1'024;
    const std::size_t step = n / kSome + 1;
    std::vector<Vec3d> some;
    for (std::size_t i = 0; i < n; i += step) {
        const Vec3d p = point_at(i);
        if (p.allFinite()) some.push_back(p);
    }
    return some;
}

/// Where nine of ten of some points lie along each axis: a few that lie far off do not count. Empty
/// for none.
inline Aabb box_of_most(std::vector<Vec3d> some) {
    Aabb box;
    if (some.empty()) return box;
    const auto few = static_cast<std::ptrdiff_t>(some.size() / 20);
    for (int axis = 0; axis < 3; ++axis) {
        const auto along = [axis](const Vec3d& p) { return p[axis]; };
        const auto first = some.begin() + few, last = some.end() - 1 - few;
        std::ranges::nth_element(some, first, {}, along);
        box.min[axis] = (*first)[axis];
        std::ranges::nth_element(some, last, {}, along);
        box.max[axis] = (*last)[axis];
    }
    return box;
}

/// A grid has its bits for most points where the box of all is so many times as wide as theirs.
inline constexpr double kFarOffGrid = 16;

inline double longest_side(const Aabb& box) {
    return box.empty() ? 0 : (box.max - box.min).maxCoeff();
}

}  // namespace stipple
