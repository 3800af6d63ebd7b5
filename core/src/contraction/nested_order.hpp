#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

/// An order of points of which every prefix is a good cloud: contraction to one end point (§3.2)
/// backwards, from the one that is left.
///
/// @param positions  finite, no two alike, at least one. O(N log N), parallel.
std::vector<Index> nested_order(std::span<const Vec3f> positions, const RunContext& context);

}  // namespace stipple
