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
    std::optional<std::uint64_t> max_cluster_size{};  ///< n_max >= 1: largest number of points in a
                                                      ///< cluster, before stray points join it
    std::optional<double>
        max_variation{};  ///< sigma_max in (0, 1/3]: growth stops at this surface variation
    Representative representative = Representative::Nearest;
    std::map<std::string, Reduction>
        reductions{};        ///< by attribute name, overriding the attribute's own
    std::uint64_t seed = 0;  ///< chooses the first seed point of clusters that are grown
};

/// Clustering by region growing (§3.1): a cluster takes the nearest free neighbours of its seed
/// until it has `max_cluster_size` points or their variation (Eq. 5) exceeds `max_variation`; the
/// next seed is a free neighbour of it. Finally the points of stray clusters, which reached half of
/// neither bound, go to the clusters with the closest centroids.
///
/// Given `target_size`, n_max is the mean size of a cluster at which about as many clusters as
/// wanted reach half of it; exactly that many, those closest to a bound, are not strays. Where
/// points are unevenly dense, the points of strays lie far from all clusters and make some of them
/// wide: then as many fewer are kept as are wider than twice the median, a fifth at most, and the
/// widest are split, across their longest direction. Clusters of fewer than 8 points in the mean
/// are not grown, but split in this way from the whole, the widest first: quicker, and as even.
/// With `max_variation` as well, trial regions estimate the n_max and variation bound that yield
/// about that many: n_max up to half as large again, so that the clusters of flat parts make up for
/// the small ones of curved parts; if there would still be too many, the bound on the variation
/// yields. If there are too few, the widest are split. What that gains is in bench/README.md, "Wide
/// clusters".
///
/// Departures from the paper: neighbours are spatial, not those of a graph, but a cluster reaches
/// no farther than 1.3 times the radius that n_max points have about its seed, so that it cannot
/// surround another. Among the last cluster's neighbours, the next seed is the one where the next
/// cluster fits best. Under a bound on the variation, growth is tried in steps of fourfold size,
/// since the variation of few points means little, and ends with the last of 16 rings about the
/// seed within the bound. From 4,096 clusters on, parts of the cloud are grown in parallel, and the
/// clusters between the parts last.
///
/// Give `target_size`, or at least one of the other two. A target above the number of points
/// returns the cloud unchanged. The cloud must hold finite, distinct positions (`clean`).
///
/// @throws Error(InvalidArgument) for an empty cloud, an option out of range or an incomplete
/// combination of options.
///
/// Expected O(N log N), parallel from 4,096 clusters on, but more where spacings differ by orders of
/// magnitude within what a cluster may reach: 600,000 points of which one in a hundred is 100,000
/// radii off take 30 times as long as without. 50 bytes per point and 200 per cluster beyond the
/// cloud.
PointCloud incremental_clustering(const PointCloud& cloud,
                                  const IncrementalClusteringOptions& options,
                                  const RunContext& context = {});

/// The clusters alone, in the order in which they were grown, halves in place of what was split.
Clusters incremental_clusters(std::span<const Vec3f> points,
                              const IncrementalClusteringOptions& options,
                              const RunContext& context = {});

}  // namespace stipple
