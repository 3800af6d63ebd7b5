#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <optional>
#include <span>

namespace stipple {

struct NormalOrientationOptions {
    unsigned k = 16;                   ///< neighbours of the Riemannian graph, 1..64
    std::optional<Vec3d> viewpoint{};  ///< relative to the origin of the cloud: every normal turns
                                       ///< towards it, and no tree is needed
};

/// Orients normals consistently between neighbours (§2.1), over a minimum spanning tree of the
/// nearest-neighbour graph (Hoppe et al. 1992). An edge costs less the more parallel the normals at
/// its ends are, and the more parallel it is to the tangent planes. Only signs change.
///
/// Each connected component is turned outward. Where a closed surface reaches farthest in a
/// direction, its outward normal is that direction, so the six points farthest along the axes vote.
/// If they do not decide, the mean normal should point up (+z): a terrain faces up.
///
/// @param normals  N unit vectors, one for each of the N points (finite, `clean`); one that is zero
/// or not finite agrees with none.
/// @throws Error(InvalidArgument) for k out of range, a number of normals other than that of
/// points, or a viewpoint that is not finite; Error(TooLarge) for 2^31 points or more.
///
/// Expected O(N k), parallel except for the tree itself; about 11 k + 60 bytes per point while it
/// runs. The same result for any number of threads.
void orient_normals(std::span<const Vec3f> points, std::span<Vec3f> normals,
                    const NormalOrientationOptions& options = {}, const RunContext& context = {});

}  // namespace stipple
