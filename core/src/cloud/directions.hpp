#pragma once

#include "stipple/point_cloud.hpp"

#include <algorithm>
#include <span>

namespace stipple {

/// Whether some normals have a direction. Files of Gaussian splats have normals that are all zero,
/// which formats of unit vectors would make directions of.
inline bool have_directions(std::span<const Vec3f> normals) {
    return std::ranges::any_of(normals,
                               [](const Vec3f& n) { return n.allFinite() && !n.isZero(0); });
}

}  // namespace stipple
