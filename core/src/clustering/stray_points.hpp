#pragma once

#include "clustering/region_growing.hpp"
#include "stipple/clusters.hpp"
#include "stipple/run_context.hpp"

#include <span>

namespace stipple {

/// The clusters that regions make (§3.1, Fig. 4a): those in `chosen` (numbers, ascending, at least
/// one), each with the points of the other regions whose closest centroid is its own, of the chosen
/// ones; the first among equals.
Clusters with_strays_joined(std::span<const Vec3f> points, const Regions& regions,
                            std::span<const Index> chosen, const RunContext& context);

}  // namespace stipple
