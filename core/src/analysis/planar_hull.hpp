#pragma once

#include <Eigen/Core>

#include <span>

namespace stipple {

/// How far the origin is from the convex hull of some points of the plane; 0 within. O(n²).
float way_to_hull(std::span<const Eigen::Vector2f> points) noexcept;

}  // namespace stipple
