#pragma once

#include "samples.hpp"

#include <span>

namespace stipple {

/// Copies the points of these numbers to where vector code reads them.
inline void gather(std::span<const Vec3f> points, std::span<const Index> numbers,
                   const MutableSampleSpan& to) noexcept {
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        const Vec3f& p = points[numbers[i]];
        to.x[i] = p.x();
        to.y[i] = p.y();
        to.z[i] = p.z();
        to.index[i] = numbers[i];
    }
}

}  // namespace stipple
