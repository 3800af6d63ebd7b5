#pragma once

#include "base/refuse.hpp"
#include "stipple/point_cloud.hpp"

#include <algorithm>
#include <cmath>

namespace stipple {

/// Whether a largest error per axis makes the steps of a grid: they are twice as long.
inline bool makes_steps(double precision) noexcept {
    return precision > 0 && std::isfinite(2 * precision);
}

/// By how much rounding to single precision moves coordinates, at most.
/// @param largest  of their sizes.
inline double rounding_of_floats(double largest) noexcept {
    return 0x1p-24 * largest;
}

/// How far positions are from where they were in their file, per axis at most: doubles are held as
/// floats.
inline double rounding_of_reading(const PointCloud& cloud) {
    if (!cloud.double_precision) return 0;
    float largest = 0;
    for (const Vec3f& p : cloud.positions) largest = std::max(largest, p.cwiseAbs().maxCoeff());
    return rounding_of_floats(largest);
}

/// Of a precision, what does not count: half of a decimal step is to make that step.
inline constexpr double kUncounted = 0.01;

/// What is left of a precision where positions have been moved by so much before they come to a
/// grid, as doubles are that a cloud holds as floats.
/// @throws Error(InvalidArgument) for a precision that makes no steps, or of which nothing is left.
inline double precision_left(double precision, double moved, double side) {
    require(makes_steps(precision), "precision", precision, "a finite number above 0");
    if (moved <= kUncounted * precision) return precision;
    if (precision > moved) return precision - moved;
    refuse("precision ", precision, ": expected at least ", 2 * moved, " for points ", side,
           " apart in single precision");
}

}  // namespace stipple
