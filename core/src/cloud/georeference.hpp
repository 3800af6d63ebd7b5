#pragma once

#include "stipple/point_cloud.hpp"

#include <vector>

namespace stipple {

/// Whether coordinates of this box need an origin is the caller's matter; this says which. A point
/// near the centre of the box, on the grid of the power of two at or above its longest side: so
/// clean that float(coordinate - origin) + origin gives most files back as they were, and so coarse
/// that the rounding of that round trip does not choose another origin next time. Coordinates then
/// stay within 1.2 grid steps of it. Zero for an empty box.
///
/// A few points far off do not count: the one at 0, 0, 0 that an instrument writes for "nothing
/// seen" would else take the decimetres of a map's coordinates. Where the box is 64 times as wide
/// as most of `some` lie in, theirs is taken; the few are then as precise as floats are there.
///
/// @param box  of the finite coordinates. @param some  of them, as `some_of` takes them.
/// @throws Error(MalformedInput) when the side of the box is beyond single precision, or below it.
Vec3d choose_origin(const Aabb& box, std::vector<Vec3d> some);

}  // namespace stipple
