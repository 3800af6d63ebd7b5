#pragma once

#include "analysis/curve_normals.hpp"
#include "stipple/point_cloud.hpp"

#include <span>

namespace stipple {

/// Moves each point to one of the 27 places of a grid around it: to where the way across the
/// surface is shortest, and the whole way short as well. It moves by two steps at most.
///
/// Points that move along a curved surface by chance make the one through all of them sag, by about
/// the curvature times the square of a step: that much they are put farther out before, but half a
/// step at most.
///
/// @param normals  of the surface at the points.
/// @param step  of the grid, which goes through 0. @param to  room for as many points.
void round_to_surface(std::span<const Vec3f> points, std::span<const NormalAndBend> normals,
                      double step, Vec3f* to) noexcept;

}  // namespace stipple
