#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

struct Ball {
    Vec3f center;
    float radius;
};

/// The numbers of the points that are within at least one of some balls, ascending. For balls that
/// are small and few beside the cloud: a pass over it, about 3 ns a point on one thread, and one
/// more for those that are much smaller than most.
///
/// @param points, balls  finite. @param low, diagonal  of the box around the points.
std::vector<Index> points_within(std::span<const Ball> balls, std::span<const Vec3f> points,
                                 const Vec3f& low, float diagonal, const RunContext& context);

}  // namespace stipple
