#pragma once

#include "stipple/incremental_clustering.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <functional>
#include <span>

namespace stipple {

/// Levels of `incremental_clustering`, finest first. One that has a finer one with enough points
/// (`levels_of_base`) has clusters of its clusters, by its points, represented by all that they
/// have of the cloud; about as near to the surface as clusters of the cloud (bench/README.md,
/// "Levels by method"). With `max_variation` all are of the cloud, whose variation it bounds.
///
/// @param sizes  descending, each in 1..N; `options.target_size` is not read.
/// @param on_cloud  called for each size, on the calling thread.
/// @throws Error(InvalidArgument) as `incremental_clustering`.
void incremental_levels(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                        const IncrementalClusteringOptions& options,
                        const std::function<void(PointCloud&&)>& on_cloud,
                        const RunContext& context);

}  // namespace stipple
