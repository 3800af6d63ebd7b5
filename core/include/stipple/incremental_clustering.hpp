#pragma once

#include "stipple/clusters.hpp"

#include <cstdint>
#include <map>
#include <optional>
#include <span>
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

/// Clustering by region growing (§3.1): a cluster takes the nearest free neighbours of its seed
/// until there are `max_cluster_size` or their variation (Eq. 5) is above `max_variation`; the next
/// seed is a free neighbour of it. Then the points of stray clusters, which reached half of neither
/// bound, go to the clusters with the closest centroids.
///
/// Given `target_size`, n_max is the mean number of points a cluster must have, with which about as
/// many clusters reach half of it as are wanted; that many, those which came nearest to a bound,
/// are no strays. With `max_variation` beside it, n_max and that bound are what some regions, tried
/// beforehand, say will give about as many: n_max up to half as large again, so that the clusters
/// of flat parts make up for the small ones of curved parts, and where there would be too many all
/// the same the bound yields. Where there are too few, those that vary most are split across their
/// longest direction.
///
/// Departures from the paper: neighbours are those in space, not of a graph, but a cluster reaches
/// no farther than 1.3 times the radius that n_max points have about its seed, so it goes round no
/// other; of the last cluster's neighbours the next seed is the one where the next cluster fits
/// beside it; under a bound on the variation, growth is tried in steps of fourfold size, since the
/// variation of few points says little, and ends with the last of 16 rings about the seed within
/// the bound. Of 4,096 clusters or more, those of parts of the cloud are grown side by side, and
/// those between the parts last.
///
/// Give `target_size`, or at least one of the other two. A target above the number of points
/// returns the cloud as it is. The cloud must hold finite positions, no two alike (`clean`).
///
/// @throws Error(InvalidArgument) for an empty cloud, an option out of range or a combination that
/// says nothing. Expected O(N log N), parallel but for fewer clusters than those; 50 bytes a point
/// and 200 a cluster beyond the cloud.
PointCloud incremental_clustering(const PointCloud& cloud,
                                  const IncrementalClusteringOptions& options,
                                  const RunContext& context = {});

/// The clusters alone, in the order in which they were grown; with a target, as many, or fewer
/// where some would have to be split.
Clusters incremental_clusters(std::span<const Vec3f> points,
                              const IncrementalClusteringOptions& options,
                              const RunContext& context = {});

}  // namespace stipple
