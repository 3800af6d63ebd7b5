#pragma once

#include "stipple/clusters.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <span>

namespace stipple {

/// Splits clusters until there are exactly `target`: of all of them, always the widest
/// (`width_of_cluster`), by the plane through its centroid across its longest direction (§3.1). The
/// halves stand where the whole stood.
///
/// @param target  as many as there are clusters, at most as many as points.
/// Expected O(N log(N / M)) for N points and M clusters.
void split_clusters(std::span<const Vec3f> points, std::uint64_t target, Clusters& clusters,
                    const RunContext& context);

}  // namespace stipple
