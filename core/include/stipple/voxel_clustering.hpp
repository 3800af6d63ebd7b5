#pragma once

#include "stipple/clusters.hpp"

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>

namespace stipple {

struct VoxelClusteringOptions {
    std::optional<std::uint64_t>
        target_size{};  ///< exactly this many points: the size of a voxel is searched
    std::optional<double> voxel_size{};  ///< edge of a voxel, input units; instead
    Representative representative = Representative::Nearest;
    std::map<std::string, Reduction>
        reductions{};  ///< by attribute name, overriding the attribute's own
};

/// Voxel clustering (Rossignac and Borrel 1993; §3.1 describes its limits): one point for each
/// occupied cube of a grid. A baseline.
///
/// The grid starts at the minimum corner of the cloud's box. Given a target, the edge of its voxels
/// is searched until slightly too few are occupied; the difference is made up by splitting the
/// voxels whose points vary most across their longest direction.
///
/// Give `target_size` or `voxel_size`. A target above the number of points returns the cloud
/// unchanged. The cloud must hold finite, distinct positions (`clean`).
///
/// @throws Error(InvalidArgument) for an empty cloud, an option out of range (a voxel must be at
/// least 2^-21 of the cloud's longest side), or both or neither of the two.
///
/// O(N); 8 bytes per point and about 40 per voxel beyond the cloud.
PointCloud voxel_clustering(const PointCloud& cloud, const VoxelClusteringOptions& options,
                            const RunContext& context = {});

/// The points of each voxel, voxels in the order of their first points; with a target, as many
/// voxels as one size gives, at most that many.
Clusters voxel_clusters(std::span<const Vec3f> points, const VoxelClusteringOptions& options,
                        const RunContext& context = {});

}  // namespace stipple
