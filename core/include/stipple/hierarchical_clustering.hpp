#pragma once

#include "stipple/clusters.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>

namespace stipple {

struct HierarchicalClusteringOptions {
    std::optional<std::uint64_t>
        target_size{};  ///< exactly this many points (priority queue); instead of the two below
    std::optional<std::uint64_t>
        max_cluster_size{};  ///< n_max >= 1: split clusters with more points
    std::optional<double>
        max_variation{};  ///< sigma_max in (0, 1/3]: split clusters with more surface variation
    Representative representative = Representative::Nearest;
    std::map<std::string, Reduction>
        reductions{};  ///< by attribute name, overriding the attribute's own
};

/// Hierarchical clustering (§3.1): a binary space partition. A cluster is split by the plane
/// through its centroid, perpendicular to the eigenvector of its largest eigenvalue, while its size
/// exceeds `max_cluster_size` or its variation (Eq. 5) exceeds `max_variation`; or, given
/// `target_size`, the cluster with most to gain is split until there are exactly that many. A
/// cluster that lies in two layers, like the sides of a wall, is split between them (ours): they
/// must have 16 points each on average, and be apart by 1.5 of their spacings.
///
/// Give `target_size`, or at least one of the other two. A target above the number of points
/// returns the cloud unchanged. The cloud must hold finite, distinct positions (`clean`).
///
/// @throws Error(InvalidArgument) for an empty cloud, an option out of range or an incomplete
/// combination of options.
///
/// O(N log M), parallel. Beyond the cloud 8 bytes per point, or 4 and about 120 per cluster,
/// whichever is more, and 8 MB per thread.
PointCloud hierarchical_clustering(const PointCloud& cloud,
                                   const HierarchicalClusteringOptions& options,
                                   const RunContext& context = {});

/// The clusters alone, in the order of the tree (left before right).
Clusters hierarchical_clusters(std::span<const Vec3f> points,
                               const HierarchicalClusteringOptions& options,
                               const RunContext& context = {});

}  // namespace stipple
