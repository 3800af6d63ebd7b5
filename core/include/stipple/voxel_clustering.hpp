#pragma once

#include "stipple/clusters.hpp"

#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace stipple {

struct VoxelClusteringOptions {
    std::optional<std::uint64_t>
        target_size{};  ///< exactly so many points: the size of a voxel is searched
    std::optional<double> voxel_size{};  ///< input units; instead
    Representative representative = Representative::Nearest;
    std::map<std::string, Reduction> reductions{};
};

/// One point for each cube of a grid that holds any (Rossignac and Borrel 1993); a baseline.
PointCloud voxel_clustering(const PointCloud& cloud, const VoxelClusteringOptions& options,
                            const RunContext& context = {});

}  // namespace stipple
