#pragma once

#include "analysis/lone_points.hpp"
#include "error/foot_finder.hpp"

#include <algorithm>

namespace stipple {

/// The distance of a foot; where that is doubtful, no more than that of the nearest sample.
/// @param doubtful_sq  the squared distance above which it is: 0 for a point that lies alone, since
/// there is no surface around it, infinite where points are close together.
inline double distance_of(const Foot& foot, float doubtful_sq) noexcept {
    return foot.distance * foot.distance > doubtful_sq ? std::min(foot.distance, foot.to_sample)
                                                       : foot.distance;
}

/// How far a place of the surface that has these points is from another, by its foot there.
inline double distance_of(const Foot& foot, const LonePoints& points, const Vec3f& place) {
    if (distance_of(foot, points.usual_area()) == foot.distance) return foot.distance;  // most are
    return distance_of(foot, points.area_of(place).doubtful_sq);
}

}  // namespace stipple
