#pragma once

#include "stipple/hierarchical_clustering.hpp"
#include "stipple/incremental_clustering.hpp"
#include "stipple/voxel_clustering.hpp"

namespace stipple {

// The ranges of a method's own options, but for its target, that hold whatever the cloud:
// `validate(SimplifyOptions)` asks for them before there is one, a method before its work.
// All throw Error(InvalidArgument).

void check_ranges(const HierarchicalClusteringOptions& options);
void check_ranges(const IncrementalClusteringOptions& options);
void check_ranges(const VoxelClusteringOptions& options);

}  // namespace stipple
