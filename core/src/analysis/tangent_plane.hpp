#pragma once

#include "stipple/point_cloud.hpp"

#include <span>

namespace stipple {

/// The tangent plane (§2.1) of a sample by the offsets of its neighbours; any where they do not
/// span one.
Vec3d normal_from(std::span<const Vec3d> neighbors) noexcept;

}  // namespace stipple
