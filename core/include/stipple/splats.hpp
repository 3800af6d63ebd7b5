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
    std::vector<Vec3f> normals;  ///< N unit vectors of arbitrary sign, or empty (`orient_normals`)
    std::vector<Vec3f> major,
        minor;  ///< N each, or empty: half axes, input units, major the longer one; their cross
                ///< product is along the normal
};

/// Measures how large a disc each point needs.
///
/// The part of the surface nearest to a point is its Voronoi cell among its neighbours in their
/// tangent plane. The disc reaches to the farthest corner of the cell, and so does the ellipse,
/// which is longer where neighbours are farther. So discs cover every place between the points, and
/// none is larger than necessary. Neighbours are the 16 nearest points, and the points that have
/// this one among theirs. If they leave a side open, at the border of a surface, a disc extends by
/// three quarters of the mean distance to the neighbours of the cell. No disc is larger than the
/// distance to the farthest point that has its point among its 16 nearest; a point that is among
/// nobody's is an outlier and gets the radius of its nearest neighbour.
///
/// Collinear points get discs that touch; two points, discs that cover the way between them; one
/// point, or a point where all others coincide with it, radius 0. Positions must be finite
/// (`clean`).
///
/// Expected O(N), parallel; about 140 bytes per point while it runs.
Splats measure_splats(std::span<const Vec3f> points, const SplatOptions& options = {},
                      const RunContext& context = {});

}  // namespace stipple
