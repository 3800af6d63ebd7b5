#pragma once

#include "neighbors/point_tree.hpp"
#include "stipple/neighbors.hpp"

#include <span>
#include <vector>

namespace stipple {

/// About the squared distance of the k-th neighbour of a point in a node of level 0, as if its 64
/// points were an even square piece of a surface; rather too much.
float guess_radius_sq(const PointTree::Node& node, unsigned k) noexcept;

/// `NeighborSearch::nearest` and `within`.
std::span<Neighbor> find_nearest(const PointTree& tree, const Vec3f& q,
                                 std::span<Neighbor> room) noexcept;
void find_within(const PointTree& tree, const Vec3f& q, float radius_sq,
                 std::vector<Neighbor>& found);
/// Whether there is one: far from all points a few comparisons tell.
bool any_within(const PointTree& tree, const Vec3f& q, float radius_sq) noexcept;
/// False, and nothing found, where these are more than 512, or the radius or a point is infinite.
bool find_few_within(const PointTree& tree, const Vec3f& q, float radius_sq,
                     std::vector<Neighbor>& found);

}  // namespace stipple
