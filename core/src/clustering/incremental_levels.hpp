#pragma once

#include "stipple/incremental_clustering.hpp"
#include "stipple/lod_pyramid.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <functional>
#include <span>

namespace stipple {

constexpr std::uint64_t kPointsToGrow = 8;  ///< of a cluster in the mean, at least

/// Whether so many clusters are split from the whole, and not grown.
bool are_split(std::uint64_t clusters, std::uint64_t points,
               const IncrementalClusteringOptions& options);

/// Levels of `incremental_clustering`, finest first. Those whose clusters are split, and where
/// there are such, others up to 128 points a cluster, are cuts of one tree of the cloud. Each of
/// the others is grown over the points of the coarsest level that has at least eight times as many,
/// else of the cloud, and represented by all that they have of the cloud; about as near to the
/// surface as clusters of the cloud (bench/README.md, "Wide clusters"). With `max_variation` all
/// are of the cloud, whose variation it bounds.
///
/// @param order  of the points along a curve, or empty; levels have their order along it.
/// @param sizes  descending, each in 1..N; `options.target_size` is not read.
/// @param on_level  called for each size, on the calling thread.
/// @throws Error(InvalidArgument) as `incremental_clustering`.
void incremental_levels(const PointCloud& cloud, std::span<const Index> order,
                        std::span<const std::uint64_t> sizes,
                        const IncrementalClusteringOptions& options,
                        const std::function<void(LodLevel&&)>& on_level, const RunContext& context);

}  // namespace stipple
