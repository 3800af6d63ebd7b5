#pragma once

#include "stipple/point_cloud.hpp"

namespace stipple {

/// Whether coordinates of this box need an origin is the caller's matter; this says which. A point
/// near the centre of the box, on the grid of the power of two at or above its longest side: so
/// clean that float(coordinate - origin) + origin gives most files back as they were, and so coarse
/// that the rounding of that round trip does not choose another origin next time. Coordinates then
/// stay within 1.2 grid steps of it. Zero for an empty box.
///
/// @param box  of the finite coordinates. @throws Error(MalformedInput) when its side is beyond
/// single precision.
Vec3d choose_origin(const Aabb& box);

}  // namespace stipple
