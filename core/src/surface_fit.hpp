#pragma once

#include "representatives.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

struct SurfaceFit {
    unsigned asked = 4;  ///< members of each list that are asked for, >= 1; shorter ones all count
    float close = 0.5F;  ///< distance of the quadratic surface, as a part of that of both surfaces
                         ///< from each other, up to which it counts more; > 0
};

/// Moves points so that the moving least squares surface through them (§2.2) comes nearer to what
/// they stand for: of linear basis, which lies inside of curved parts, and of quadratic basis,
/// which does not. A damped step, of all points together, towards the least sum of squares of both
/// distances from some members of each list. Both count the same, but where the quadratic surface
/// is `close`: there it counts more, so that it is not spoilt.
///
/// Points go mostly along normals, to where the surface is missed, and a little across, to where it
/// bends. Points on a line or in one place stay where they are, and so do fewer than 20, which make
/// no such surface.
///
/// @param input  what the members are numbers of.
/// @param members  of each point; a list is never empty.
/// Members count only where they are within the reach of their point's 20 nearest. About 0.5 us for
/// each point and each of them, parallel; 60 bytes a point, and for up to 12,000 points at a time
/// 200 bytes and 500 for each member asked.
void fit_surface(std::vector<Vec3f>& points, std::span<const Vec3f> input,
                 const MemberLists& members, const SurfaceFit& options, const RunContext& context);

}  // namespace stipple
