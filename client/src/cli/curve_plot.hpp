#pragma once

#include "stipple/proto/results.hpp"

#include <span>
#include <string>

namespace stipple::cli {

/// The count-error curve as an SVG picture: error over points, both axes logarithmic, one line for
/// each of maximum, root mean square and mean, in either direction.
///
/// @param levels  those of a curve job, the coarsest first; at least one.
/// @param title  above the picture.
std::string curve_plot(std::span<const proto::OutputCloud> levels, const std::string& title);

}  // namespace stipple::cli
