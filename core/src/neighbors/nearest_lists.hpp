#pragma once

#include "stipple/neighbors.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstddef>
#include <span>
#include <vector>

namespace stipple {

/// What `k_nearest_neighbors` finds, for each point as many, without the distances.
struct NearestLists {
    std::vector<Index> indices;  ///< flat: those of point i begin at i * each
    std::size_t each = 0;

    /// Nearest first, the smaller index first among equals.
    std::span<const Index> of(std::size_t i) const noexcept {
        return {indices.data() + i * each, each};
    }
};

/// @param k  >= 1; of n points each has at most n - 1.
/// As `k_nearest_neighbors`, with half the memory: 4 k bytes a point, and about 50 more while it
/// runs.
NearestLists nearest_lists(std::span<const Vec3f> points, unsigned k, const RunContext& context);

}  // namespace stipple
