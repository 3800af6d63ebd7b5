#pragma once

#include "error/error_frame.hpp"
#include "error/framed_surface.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/run_context.hpp"
#include "stipple/surface_error.hpp"

#include <cstdint>
#include <span>

namespace stipple {

/// One of the directions of `estimate_error`, by what was found at places: their distances in a
/// frame, the areas that they stand for, from which no walk came to an end, and their distances
/// from the nearest point.
DirectedError summarize_places(std::span<const float> distances, std::span<const float> areas,
                               std::span<const std::uint8_t> endless, std::span<const float> covers,
                               const ErrorFrame& frame, const RunContext& context);

/// The direction of `estimate_error` from a candidate, with its tree, to a reference that is there
/// as a whole: for the levels of a pyramid.
///
/// @param frame  of both.
DirectedError estimate_backward(const FramedSurface& reference, std::span<const Vec3f> candidate,
                                const PointTree& tree, const ErrorFrame& frame,
                                const RunContext& context);

}  // namespace stipple
