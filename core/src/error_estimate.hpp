#pragma once

#include "error_frame.hpp"
#include "error_samples.hpp"
#include "framed_surface.hpp"
#include "stipple/run_context.hpp"
#include "stipple/surface_error.hpp"

namespace stipple {

/// `estimate_error` where both surfaces are there as a whole, and places on the reference: for the
/// levels of a pyramid.
///
/// @param frame  of both. @return  without the diagonals.
SurfaceError estimate_error(const FramedSurface& reference, const ErrorSamples& on_reference,
                            const FramedSurface& candidate, const ErrorFrame& frame,
                            const RunContext& context);

}  // namespace stipple
