#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

struct SplatOptions {
    bool normals = false;   ///< also the plane of each splat
    bool ellipses = false;  ///< also the half axes of each, in that plane
};

/// Discs that cover the surface of N points without holes (Fig. 5).
struct Splats {
    std::vector<float> radii;    ///< N, input units
    std::vector<Vec3f> normals;  ///< N unit vectors, or empty; the sign is any (`orient_normals`)
    std::vector<Vec3f> major,
        minor;  ///< N each, or empty: half axes, input units, major the longer; their cross product
                ///< is along the normal
};

/// Measures how large a disc each point needs.
///
/// The part of the surface that lies nearest to a point is its Voronoi cell among its neighbours in
/// their tangent plane: the disc reaches to the farthest corner of the cell, the ellipse, which is
/// longer where neighbours are farther, as well. So discs cover every place between the points, and
/// none is larger than that takes. Neighbours are the 16 nearest, and the points that have this one
/// among theirs. Where they leave a side open, at the border of a surface, a disc extends by
/// three quarters of the mean distance to the neighbours of the cell. No disc is larger than the
/// distance to the farthest point that has its point among its 16 nearest; one that is among
/// nobody's is an outlier and gets the radius of its nearest neighbour.
///
/// Points on a line get discs that touch; two points, discs that cover what is between; one point,
/// or one at which all others lie, radius 0. Positions must be finite (`clean`).
///
/// Expected O(N), parallel; about 140 bytes a point while it runs.
Splats measure_splats(std::span<const Vec3f> points, const SplatOptions& options = {},
                      const RunContext& context = {});

}  // namespace stipple
