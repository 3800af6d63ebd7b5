#include "analysis/planar_hull.hpp"

#include <algorithm>
#include <limits>

namespace stipple {

namespace {

float cross(const Eigen::Vector2f& a, const Eigen::Vector2f& b) noexcept {
    return a.x() * b.y() - a.y() * b.x();
}

/// Whether all points lie on one side of a line through the origin: seen from there, one of them
/// has all others to its left, and none opposite.
bool is_outside(std::span<const Eigen::Vector2f> points) noexcept {
    return std::ranges::any_of(points, [&](const Eigen::Vector2f& first) {
        return std::ranges::all_of(points, [&](const Eigen::Vector2f& other) {
            const float side = cross(first, other);
            return side > 0 || (side == 0 && first.dot(other) > 0);
        });
    });
}

float distance_to_segment(const Eigen::Vector2f& a, const Eigen::Vector2f& b) noexcept {
    const Eigen::Vector2f way = b - a;
    const float length_sq = way.squaredNorm();
    const float part = length_sq > 0 ? std::clamp(-a.dot(way) / length_sq, 0.0F, 1.0F) : 0.0F;
    return (a + part * way).norm();
}

}  // namespace

float way_to_hull(std::span<const Eigen::Vector2f> points) noexcept {
    if (!is_outside(points)) return 0;
    float nearest =
        std::numeric_limits<float>::infinity();  // of what is in the hull, with its sides
    for (std::size_t i = 0; i < points.size(); ++i)
        for (std::size_t j = i; j < points.size(); ++j)
            nearest = std::min(nearest, distance_to_segment(points[i], points[j]));
    return nearest;
}

}  // namespace stipple
