#pragma once

#include "point_tree.hpp"
#include "stipple/neighbors.hpp"

#include <span>
#include <vector>

namespace stipple {

/// `NeighborSearch::nearest` and `within`.
std::span<Neighbor> find_nearest(const PointTree& tree, const Vec3f& q,
                                 std::span<Neighbor> room) noexcept;
void find_within(const PointTree& tree, const Vec3f& q, float radius_sq,
                 std::vector<Neighbor>& found);

}  // namespace stipple
