#pragma once

#include "stipple/clusters.hpp"

#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace stipple {

struct IncrementalClusteringOptions {
    std::optional<std::uint64_t>
        target_size{};  ///< exactly this many points: the size bound is searched; instead of the
                        ///< two below, or with `max_variation`, which then shapes the clusters
    std::optional<std::uint64_t>
        max_cluster_size{};  ///< n_max >= 1: a cluster grows to at most so many points
    std::optional<double>
        max_variation{};  ///< sigma_max in (0, 1/3]: growth stops at this surface variation
    Representative representative = Representative::Nearest;
    std::map<std::string, Reduction>
        reductions{};        ///< by attribute name, instead of the attribute's own
    std::uint64_t seed = 0;  ///< chooses the first seed point
};

/// Clustering by region growing (§3.1).
PointCloud incremental_clustering(const PointCloud& cloud,
                                  const IncrementalClusteringOptions& options,
                                  const RunContext& context = {});

/// The clusters alone, in the order in which they were grown.
Clusters incremental_clusters(std::span<const Vec3f> points,
                              const IncrementalClusteringOptions& options,
                              const RunContext& context = {});

}  // namespace stipple
