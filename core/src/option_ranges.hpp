#pragma once

#include "stipple/hierarchical_clustering.hpp"
#include "stipple/incremental_clustering.hpp"
#include "stipple/multiphase.hpp"
#include "stipple/particle_simulation.hpp"
#include "stipple/voxel_clustering.hpp"

#include <string>

namespace stipple {

// The ranges of a method's own options, but for its target, that hold whatever the cloud:
// `validate(SimplifyOptions)` asks for them before there is one, a method before its work.
// All throw Error(InvalidArgument).

void check_ranges(const HierarchicalClusteringOptions& options);
void check_ranges(const IncrementalClusteringOptions& options);
void check_ranges(const IterativeSimplificationOptions& options);
void check_ranges(const MultiphaseOptions& options);
void check_ranges(const ParticleSimulationOptions& options);
void check_ranges(const VoxelClusteringOptions& options);

/// A finite number above 0.
void require_positive(const std::string& name, double value);

}  // namespace stipple
