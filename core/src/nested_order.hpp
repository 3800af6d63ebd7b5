#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

/// An order of points of which every prefix is a good cloud: contraction to one end point (§3.2)
/// backwards.
struct NestedOrder {
    std::vector<Index> points;   ///< first the one that was left
    std::vector<Index> parents;  ///< by place in the order: the place, before this one, of the
                                 ///< point into which it was contracted; of the first, 0
};

/// @param positions  finite, no two alike, at least one. O(N log N), parallel.
NestedOrder nested_order(std::span<const Vec3f> positions, const RunContext& context);

}  // namespace stipple
