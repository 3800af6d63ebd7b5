#pragma once

#include "neighbors/point_tree.hpp"
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

/// What about the points of a cloud is usual, and which of them lie alone, as stray returns of a
/// scanner do: at least so many times as far from their neighbours as most are, and off a part
/// whose points are close together, or amid others that lie on no surface.
class LonePoints {
public:
    /// @param points  must outlive this, like their tree. 0.1 ms, or 0.7 if they are not in the
    /// cache.
    LonePoints(std::span<const Vec3f> points, const PointTree& tree);

    /// Of a part of a cloud, where what is usual is known of every so many of its points.
    LonePoints(std::span<const Vec3f> part, const PointTree& tree, const LonePoints& some,
               double every);

    const PointTree& tree() const noexcept { return tree_; }

    /// @param place  a point, or a place near one. @param reach  how far its third neighbour is, or
    /// more; nothing is looked for where it is as usual.
    bool holds(const Vec3f& place, float reach) const;
    /// @param nearest  of a point the nine nearest, itself the first.
    bool holds(std::span<const Neighbor> nearest) const;

    /// The area around a point, up to a factor that is the same for all: the mean of the squared
    /// distances to itself and its eight nearest. A point that lies alone stands for as much as
    /// most do, and none for more than 512 times what nineteen of twenty do, or half the
    /// square about most of them: a stray one far off would stand for more than all others.
    struct Area {
        float area;
        float doubtful_sq;  ///< squared distance above which a foot is doubtful, for `distance_of`
    };
    /// @param mean_sq  that mean.
    Area area_of(const Vec3f& point, float mean_sq) const;
    Area area_of(const Vec3f& point) const;
    /// What most points have.
    float usual_area() const noexcept { return usual_area_; }
    /// No area is above this.
    float largest() const noexcept { return largest_; }

private:
    std::span<const Vec3f> points_;
    const PointTree& tree_;
    float usual_ = 0;       ///< the most that a reach is where nothing is looked for
    float usual_area_ = 0;  ///< the median
    float wide_ = 0;        ///< areas above it are looked into
    float largest_ = 0;     ///< areas are cut off there
};

}  // namespace stipple
