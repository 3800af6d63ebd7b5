#pragma once

#include "stipple/codec.hpp"
#include "stipple/proto/results.hpp"

#include <cmath>

namespace stipple::proto {

/// What rounding to a grid of such steps adds to an error, at most.
inline FileError error_of_step(double step) {
    // Of a step: the mean over a cube is 0.48, that of a plane along the grid up to a half.
    constexpr double kMean = 0.5;
    return {kMean * step, 0.5 * std::sqrt(3.0) * step};
}

/// The longest steps that a Draco file of points `side` apart may have.
inline double longest_step(const DracoEncodeOptions& draco, double side) {
    if (draco.precision) return 2 * *draco.precision;
    const double steps = std::ldexp(1.0, static_cast<int>(draco.position_bits)) - 1;
    return steps > 0 ? side / steps : 0;
}

}  // namespace stipple::proto
