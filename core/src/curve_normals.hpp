#pragma once

#include "point_tree.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <vector>

namespace stipple {

/// The normals of the surface at the points of a tree, by their numbers, of any sign: each by those
/// in its leaf and the two beside it on the curve, the nearest with most weight. A tenth of the time
/// that all the nearest take, and as good to round points by; up where there is no plane.
/// Parallel.
std::vector<Vec3f> curve_normals(const PointTree& tree, const RunContext& context);

}  // namespace stipple
