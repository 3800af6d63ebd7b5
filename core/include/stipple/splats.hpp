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
    std::vector<Vec3f> normals;  ///< N unit vectors, or empty
    std::vector<Vec3f> major,
        minor;  ///< N each, or empty: half axes, input units, major the longer
};

Splats measure_splats(std::span<const Vec3f> points, const SplatOptions& options = {},
                      const RunContext& context = {});

}  // namespace stipple
