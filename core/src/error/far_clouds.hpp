#pragma once

#include "cloud/boxed_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/surface_error.hpp"

#include <optional>

namespace stipple {

/// The error where one of two clouds is as good as a point: where all points of the other are
/// farther from the middle of its box than a hundred times its diagonal. So it is with clouds in
/// different units, or far apart. Distances are those to that middle, within 1 %; each point of the
/// other cloud counts alike. None where clouds can be compared, or the one has fewer than 64
/// points. O(N), and no memory but for samples that are kept.
///
/// @param reference, candidate  not empty, of finite coordinates.
std::optional<SurfaceError> measure_far(const BoxedCloud& reference, const BoxedCloud& candidate,
                                        const SurfaceErrorOptions& options,
                                        const RunContext& context);

}  // namespace stipple
