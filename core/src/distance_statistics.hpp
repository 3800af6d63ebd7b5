#pragma once

#include "stipple/surface_error.hpp"

#include <array>
#include <span>

namespace stipple {

/// Sums a list of differences up, each with the area that it stands for: maximum, mean, root mean
/// square. Areas are not negative, and not all zero.
AttributeError summarize(std::string name, std::span<const float> differences,
                         std::span<const float> areas);

/// All of a `DirectedError` that distances say.
DirectedError summarize_distances(std::span<const float> distances, std::span<const float> areas,
                                  unsigned histogram_bins);

/// The least of the values that the part `q` of the weight does not exceed. O(N).
double weighted_quantile(std::span<const float> values, std::span<const float> weights, double q);

}  // namespace stipple
