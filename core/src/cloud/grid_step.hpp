#pragma once

#include <cmath>

namespace stipple {

/// Whether a largest error per axis makes the steps of a grid: they are twice as long.
inline bool makes_steps(double precision) noexcept {
    return precision > 0 && std::isfinite(2 * precision);
}

}  // namespace stipple
