#pragma once

#include "stipple/proto/results.hpp"

#include <cmath>

namespace stipple::proto {

/// What rounding to a grid of such steps adds to an error, at most.
inline FileError error_of_step(double step) {
    // Of a step: the mean over a cube is 0.48, that of a plane along the grid up to a half.
    constexpr double kMean = 0.5;
    return {kMean * step, 0.5 * std::sqrt(3.0) * step};
}

}  // namespace stipple::proto
