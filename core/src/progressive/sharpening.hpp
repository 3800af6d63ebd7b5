#pragma once

#include "progressive/cell_surface.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

/// The ways from places to where the linear surface (§4) through them about passes: from each along
/// the normal of its tangent plane to the mean of it and its neighbours; none where there are fewer
/// than three. Few points on what is bent have their surface inside of it. Points put out by these
/// ways, times a factor below 1, have it where they were: one step of van Cittert's deconvolution
/// (1931).
///
/// The same in JavaScript, bit by bit. O(n), parallel.
std::vector<Vec3d> ways_to_surface(std::span<const Cell> places, unsigned block_bits,
                                   const RunContext& context);

}  // namespace stipple
