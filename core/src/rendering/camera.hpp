#pragma once

#include "stipple/splat_renderer.hpp"

namespace stipple {

/// A point seen by a camera: to the right, up and away, in input units.
inline Vec3d seen(const Camera& camera, const Vec3d& p) {
    const Vec3d d = p - camera.eye;
    return {d.dot(camera.right), d.dot(camera.up), d.dot(camera.forward)};
}

}  // namespace stipple
