#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <optional>
#include <span>

namespace stipple {

struct NormalOrientationOptions {
    unsigned k = 16;                   ///< neighbours of the Riemannian graph
    std::optional<Vec3d> viewpoint{};  ///< relative to the origin of the cloud: every normal turns
                                       ///< towards it, and no tree is needed
};

/// Turns normals so that neighbours agree (§2.1): over a minimum spanning tree of the neighbour
/// graph, whose edges cost 1 - |n_i . n_j| (Hoppe et al. 1992). Each connected part is outward.
void orient_normals(std::span<const Vec3f> points, std::span<Vec3f> normals,
                    const NormalOrientationOptions& options = {}, const RunContext& context = {});

}  // namespace stipple
