#pragma once

#include "stipple/point_cloud.hpp"

#include <array>
#include <cstddef>
#include <optional>

namespace stipple {

/// Some points: all x, all y and all z.
struct PointsByAxis {
    std::array<const float*, 3> axes;
    std::size_t size = 0;

    Vec3d operator[](std::size_t i) const { return {axes[0][i], axes[1][i], axes[2][i]}; }
};

/// How far a neighbourhood is one of a line and not of a surface, by λ1 / λ2 and λ0 / λ1 of its
/// weighted covariance: 1 where it has hardly any breadth, or little and about as much thickness,
/// so that no plane through it is better than another; 0 on a surface, also on the lines of a scan
/// as long as others beside them tell which; between both in between, so that no distance leaps.
double line_part(double breadth, double roundness) noexcept;

/// A line through points, such as wires and edges are: what of a curve is near a place.
struct LocalLine {
    Vec3d point = Vec3d::Zero();  ///< the weighted mean
    Vec3d direction = Vec3d::UnitX();

    Vec3d foot_of(const Vec3d& q) const { return point + direction.dot(q - point) * direction; }
};

/// The scale h of weights on a line over that on a surface, for k neighbours: with it both reach as
/// far for the same spacing, of which r is k / 2 on a line and sqrt(k / π) on a surface.
double line_scale(unsigned k) noexcept;

/// The line of weighted least squares through the points around a place; what is farther than the
/// radius does not count, but the nearest always does.
///
/// @param h  the scale of the weights; more where the nearest point is farther than that.
/// @return nothing where the points coincide.
std::optional<LocalLine> fit_line(const PointsByAxis& points, const Vec3d& place, double h,
                                  double radius);

}  // namespace stipple
