#pragma once

#include "neighbors/point_tree.hpp"
#include "stipple/neighbors.hpp"

#include <cstddef>
#include <span>
#include <vector>

namespace stipple {

/// Finds the points around places of which each is near the last: how far the last had to look says
/// where to begin. For one thread.
class NearbySearch {
public:
    /// @param least  points to find (or all there are). @param most  what there is room for.
    NearbySearch(const PointTree& tree, std::size_t least, std::size_t most);

    /// Between `least` and `most` points around q, in any order, none missing within `reach()`.
    std::span<Neighbor> find(const Vec3f& q);

    /// The same where no more than the last radius has to be looked through; else nothing.
    std::span<Neighbor> find_near(const Vec3f& q);

    /// The `least` nearest to q, in any order.
    std::span<Neighbor> find_nearest_few(const Vec3f& q);

    /// Infinite where the last answer was all points.
    double reach() const noexcept { return reach_; }

private:
    /// As `find_near`, a few times wider where that finds some, but too few.
    std::span<Neighbor> find_wider(const Vec3f& q);
    /// Without a radius to begin with.
    std::span<Neighbor> find_so_many(const Vec3f& q, std::size_t count);

    const PointTree& tree_;
    std::size_t least_, most_;
    std::vector<Neighbor> room_, within_;
    double radius_ = 0, reach_ = 0;
};

}  // namespace stipple
