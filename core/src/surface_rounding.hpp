#pragma once

#include "stipple/point_cloud.hpp"

#include <span>

namespace stipple {

/// Moves each point to one of the 27 places of a grid around it: to where the way across the
/// surface is shortest, and the whole way short as well. It moves by a step and a half at most.
///
/// @param normals  of the surface at the points, unit vectors.
/// @param step  of the grid, which goes through 0. @param to  room for as many points.
void round_to_surface(std::span<const Vec3f> points, std::span<const Vec3f> normals, double step,
                      Vec3f* to) noexcept;

}  // namespace stipple
