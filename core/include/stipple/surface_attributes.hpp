#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <optional>

namespace stipple {

/// How the signs of normals are chosen.
enum class NormalSigns {
    SpanningTree,  ///< neighbours agree, each connected part outward (§2.1)
    Viewpoint,     ///< towards a point, as of a scanner
    Any,           ///< as they come
};

struct SurfaceAttributeOptions {
    unsigned k = 16;  ///< size of a neighbourhood, 3..64; 0: chosen for each point
    NormalSigns signs = NormalSigns::SpanningTree;
    std::optional<Vec3d>
        viewpoint{};  ///< with `NormalSigns::Viewpoint`, relative to the origin of the cloud
};

/// Checks what can be checked without a cloud. @throws Error(InvalidArgument).
void validate(const SurfaceAttributeOptions& options);

/// Writes the local surface properties of §2 and §2.1 (`analyze_locally`) into a cleaned cloud: its
/// normals, and the attributes `variation`, `density` and `anisotropy` (float, mean). Normals and
/// attributes of these names that it had are replaced.
/// @throws Error(InvalidArgument) for options out of range or a cloud without points.
void add_surface_attributes(PointCloud& cloud, const SurfaceAttributeOptions& options = {},
                            const RunContext& context = {});

/// How much is told of the splat (Fig. 5) of each point.
enum class SplatAttributes {
    None,
    Radius,   ///< `radius`
    Normal,   ///< `radius`, and the normals
    Ellipse,  ///< `radius`, the normals, and the half axes `major` and `minor` of 3 components each
};

/// Writes the splats of a cloud's points (`measure_splats`) into it. Attributes of these names that
/// it had are replaced; normals that it had stay, for they carry a sign.
void add_splats(PointCloud& cloud, SplatAttributes attributes, const RunContext& context = {});

}  // namespace stipple
