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

/// Turns normals so that neighbours agree (§2.1): over a minimum spanning tree of the graph of
/// nearest neighbours (Hoppe et al. 1992), whose edges cost the less the more parallel the normals
/// at their ends and the tangent planes and the edge are. No normal changes but in sign.
///
/// Each connected part is turned outward: where a closed surface reaches farthest in a direction,
/// its outward normal is that direction, so the six points that are farthest along the axes vote,
/// and the mean normal, by how far it points up (+z), decides where they do not: a terrain faces
/// up.
///
/// @param normals  N unit vectors beside the N points (finite, `clean`); one that is zero or not
/// finite agrees with none.
/// @throws Error(InvalidArgument) for k out of range, another number of normals than points, or a
/// viewpoint that is not finite; Error(TooLarge) for 2^31 points or more.
/// Expected O(N k), in parallel but for the tree itself; about 11 k + 60 bytes a point while it
/// runs. The same result for any number of threads.
void orient_normals(std::span<const Vec3f> points, std::span<Vec3f> normals,
                    const NormalOrientationOptions& options = {}, const RunContext& context = {});

}  // namespace stipple
