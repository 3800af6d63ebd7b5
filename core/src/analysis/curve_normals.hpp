#pragma once

#include "neighbors/point_tree.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <vector>

namespace stipple {

/// The normal of a surface at a point, and its mean curvature: above 0 where it bends towards the
/// normal. About half of it: planes through points to one side are tilted. Little where it is
/// noise.
struct NormalAndBend {
    Vec3f normal = Vec3f::UnitZ();
    float bend = 0;

    bool operator==(const NormalAndBend&) const = default;
};

/// The normals of the surface at the points of a tree, by their numbers, of any sign: each by those
/// in its leaf and the two beside it on the curve, the nearest with most weight. A tenth of the
/// time that all the nearest take, and as good to round points by; up, and flat, where there is no
/// plane. Parallel.
std::vector<NormalAndBend> curve_normals(const PointTree& tree, const RunContext& context);

}  // namespace stipple
