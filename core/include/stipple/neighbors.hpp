#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

/// The neighbours of many points, flat: those of point i are `indices[offsets[i]] ..
/// indices[offsets[i + 1]]`, nearest first, the smaller index first among equals.
struct NeighborLists {
    std::vector<Index> indices;
    std::vector<float> distances_sq;     ///< beside each index, in squared input units
    std::vector<std::uint64_t> offsets;  ///< N + 1

    std::size_t size() const noexcept { return offsets.empty() ? 0 : offsets.size() - 1; }
    std::span<const Index> of(std::size_t i) const noexcept {
        return {indices.data() + offsets[i], indices.data() + offsets[i + 1]};
    }
};

/// The k nearest neighbours N_p of every point (§2), the point itself left out; fewer when there
/// are fewer points.
///
/// Exact: by (squared distance in float, index). Positions must be finite (`clean`).
/// @param k  >= 1. @throws Error(InvalidArgument) for k = 0.
/// Expected O(N k) for points on surfaces; 8 k + 8 bytes a point, and about 50 more while it runs.
NeighborLists k_nearest_neighbors(std::span<const Vec3f> points, unsigned k,
                                  const RunContext& context = {});

/// All points within `radius` (input units, inclusive) of every point, the point itself left out.
/// @throws Error(InvalidArgument) for a radius that is not finite and positive; Error(TooLarge)
/// above 2^32 pairs.
NeighborLists radius_neighbors(std::span<const Vec3f> points, float radius,
                               const RunContext& context = {});

/// Mean distance to the nearest other point, in input units: of all points, or in a large cloud of
/// about 65,536 of them spread evenly over it. 0 for fewer than two points.
double mean_spacing(std::span<const Vec3f> points, const RunContext& context = {});

}  // namespace stipple
