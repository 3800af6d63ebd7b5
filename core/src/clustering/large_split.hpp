#pragma once

#include "clustering/sample_moments.hpp"
#include "stipple/run_context.hpp"

#include <span>

namespace stipple {

/// Of the points of these numbers, at least one. Parallel.
SampleMoments moments_of_many(std::span<const Vec3f> points, std::span<const Index> numbers,
                              const std::array<float, 3>& reference, const RunContext& context);

/// The moments of what lies on either side of a plane.
struct Sides {
    SampleMoments left, right;
};

/// Puts the numbers of the points left of the plane in front of the others. Parallel, the same for
/// any number of threads; what was nearly in order on entry is so on either side.
///
/// @param room  for as many numbers.
Sides partition_many(std::span<const Vec3f> points, std::span<Index> numbers,
                     const SplitPlane& plane, std::span<Index> room, const RunContext& context);

}  // namespace stipple
