#pragma once

#include "point_tree.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/point_cloud.hpp"

#include <span>

namespace stipple {

/// Whether a point lies far off a part of the cloud whose points are close together: its third
/// neighbour has three others much nearer. It stands for itself, and for no surface around it:
/// there is none as wide as the way to its neighbours.
///
/// @param nearest  the point itself, which comes first, and the eight nearest to it, by distance.
bool lies_alone(std::span<const Neighbor> nearest, std::span<const Vec3f> points) noexcept;

/// The points of a cloud that lie alone, and at least so many times as far from their neighbours as
/// most do.
class LonePoints {
public:
    /// @param points  must outlive this, like their tree.
    LonePoints(std::span<const Vec3f> points, const PointTree& tree);

    /// @param place  a point, or a place near one. @param reach  how far its third neighbour is, or
    /// more; nothing is looked for where it is as usual.
    bool holds(const Vec3f& place, float reach) const;

private:
    std::span<const Vec3f> points_;
    const PointTree& tree_;
    float usual_;  ///< the most that a reach is where nothing is looked for
};

}  // namespace stipple
