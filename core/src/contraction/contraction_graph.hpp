#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace stipple {

/// The samples along a space-filling curve, and the k nearest neighbours of each (§3.2).
struct ContractionGraph {
    static constexpr Index kNone = std::numeric_limits<Index>::max();  ///< ends a list

    std::vector<Index> order;             ///< the sample at each place on the curve
    std::vector<Index> neighbors;         ///< k places for each place, nearest first
    std::vector<std::uint32_t> tangents;  ///< of each place, `packed`; or empty
};

/// @param k  3..32.
/// @param with_tangents  from the 16 nearest neighbours, or k if that is more.
/// O(N log N), parallel; 12 + 4 k bytes a sample, and about 30 more while it runs.
ContractionGraph contraction_graph(std::span<const Vec3f> positions, unsigned k, bool with_tangents,
                                   const RunContext& context);

}  // namespace stipple
