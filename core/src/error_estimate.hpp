#pragma once

#include "framed_surface.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/surface_error.hpp"

#include <memory>

namespace stipple {

/// `estimate_error` where the surface of the reference is there, for which most of the time goes
/// else: for the levels of a pyramid.
///
/// @param reference  the cloud in its `ErrorFrame`. @param box  its bounds.
SurfaceError estimate_error(const std::shared_ptr<const FramedSurface>& reference, const Aabb& box,
                            const PointCloud& candidate, const RunContext& context);

}  // namespace stipple
