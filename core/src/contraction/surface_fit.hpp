#pragma once

#include "clustering/representatives.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

struct SurfaceFit {
    unsigned asked = 4;  ///< members of each list that are asked for, >= 1; shorter ones all count
    float close = 0.5F;  ///< distance of the quadratic surface, as a part of that of both surfaces
                         ///< from each other, up to which it counts more; > 0
    float damping = 0.5F;  ///< what a move costs, as a part of what the distances weigh at a point
                           ///< on average; > 0
    float farthest_move = 0.2F;  ///< of a point, as a part of its h (§2.2), a third of the distance
                                 ///< of the farthest of its 20 nearest; > 0
    bool in_order = false;  ///< whether the points follow a curve or a tree already, which saves
                            ///< ordering them
};

/// Moves points so that the moving least squares surface through them (§2.2) comes nearer to what
/// they stand for: of linear basis, which lies inside of curved parts, and of quadratic basis,
/// which does not. A damped step, of all points together, towards the least sum of squares of both
/// distances from some members of each list. Both count the same, but where the quadratic surface
/// is `close`: there it counts more, so that it is not spoilt.
///
/// `farthest_move` is a guard of the largest error: where the surface has an edge, which it cannot
/// follow, points would be pushed far beyond it.
///
/// Where the neighbours lie in two layers (layers.hpp), the surface through both is that of
/// neither: there points go amid their members instead.
///
/// Points go mostly along normals, to where the surface is missed, and a little across, to where it
/// bends. Points on a line or in one place stay where they are, and so do fewer than 20, which make
/// no such surface.
///
/// @param input  what the members are numbers of: points on the surface, or near.
/// @param members  of each point; a list is never empty.
/// Members count only where they are within the reach of their point's 20 nearest. About 0.5 us for
/// each point and each of them, parallel; 70 bytes a point, and on each thread for up to 12,000
/// points at a time, or 6,000 where more than 4 members are asked, 200 bytes and 500 for each
/// member asked.
void fit_surface(std::vector<Vec3f>& points, std::span<const Vec3f> input,
                 const MemberLists& members, const SurfaceFit& options, const RunContext& context);

}  // namespace stipple
