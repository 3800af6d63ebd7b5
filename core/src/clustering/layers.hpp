#pragma once

#include "cloud/samples.hpp"
#include "clustering/sample_moments.hpp"

#include <optional>

namespace stipple {

// The two sides of a wall, a sheet or a leaf are different surfaces (§2.1), however close: a point
// made of both would lie half way, where there is no surface. They are told by the heights of
// points over the plane through them. Of all distributions, those of two values alone have the
// least kurtosis for their skewness, so that (skewness^2 + 1) / kurtosis is 1 (Pearson 1916); it is
// 0.56 for the heights of a bent surface and 0.33 for noise. A few points far off have such heights
// as well, but a large kurtosis.

/// From which on that ratio tells of two layers, and the kurtosis up to which it does.
inline constexpr float kLayered = 0.85F, kMostKurtosis = 5;

/// The plane between two layers, where samples lie in such: 32 of them or more, as the heights of
/// fewer may be so by chance, and farther apart than the samples of either are from each other.
std::optional<SplitPlane> plane_between_layers(const SampleSpan& samples,
                                               const SampleMoments& moments, const Spread& spread);

}  // namespace stipple
