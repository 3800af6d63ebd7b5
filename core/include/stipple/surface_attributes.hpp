#pragma once

#include "stipple/feature_lines.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <optional>

namespace stipple {

/// How the signs of normals are chosen.
enum class NormalSigns {
    SpanningTree,  ///< consistent between neighbours, each connected component outward (§2.1)
    Viewpoint,     ///< towards a point, such as a scanner
    Any,           ///< as computed
};

struct SurfaceAttributeOptions {
    unsigned k = 0;  ///< size of a neighbourhood, 3..64; 0: chosen for each point
                     ///< (`LocalAnalysisOptions::k`), for noise and scan lines
    NormalSigns signs = NormalSigns::SpanningTree;
    std::optional<Vec3d>
        viewpoint{};  ///< with `NormalSigns::Viewpoint`, relative to the origin of the cloud
    std::optional<FeatureLineOptions> feature_lines{};  ///< absent: none are extracted
};

/// Checks what can be checked without a cloud.
/// @throws Error(InvalidArgument).
void validate(const SurfaceAttributeOptions& options);

/// Writes the local surface properties of §2 and §2.1 (`analyze_locally`) into a cleaned cloud: its
/// normals, and the attributes `variation`, `density` and `anisotropy` (float, mean); with
/// `feature_lines` also `feature_weight` (`FeatureLines::weights`). These replace normals and
/// attributes of the same names.
///
/// @return with `feature_lines`, the points of all lines, one line after the other, with all their
/// attributes and the number of the line as `line` (uint32); a closed line ends at its first point.
/// Otherwise no points.
/// @throws Error(InvalidArgument) for options out of range or a cloud without points.
///
/// Time and memory are those of `analyze_locally`, `orient_normals` and `find_feature_lines`.
PointCloud add_surface_attributes(PointCloud& cloud, const SurfaceAttributeOptions& options = {},
                                  const RunContext& context = {});

/// Which attributes describe the splat (Fig. 5) of each point.
enum class SplatAttributes {
    None,
    Radius,   ///< `radius`
    Normal,   ///< `radius`, and the normals
    Ellipse,  ///< `radius`, the normals, and the half axes `major` and `minor` of 3 components each
};

/// Writes the splats of a cloud's points (`measure_splats`) into it, replacing attributes of the
/// same names. Existing normals are kept, since they carry a sign; otherwise normals are oriented
/// consistently (`orient_normals`).
void add_splats(PointCloud& cloud, SplatAttributes attributes, const RunContext& context = {});

}  // namespace stipple
