#pragma once

#include "stipple/surface_error.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace stipple::proto {

/// What a picture says of a candidate under its name: how many points it has, how far it is.
std::vector<std::string> error_notes(std::uint64_t points, const SurfaceError& error);

/// What a picture says of its colours, which end at `range` input units.
std::string distance_legend(double range, const SurfaceError& error);

}  // namespace stipple::proto
