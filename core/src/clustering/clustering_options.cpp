#include "clustering/clustering_options.hpp"

#include "base/refuse.hpp"

#include <cstdint>

namespace stipple {

namespace {

template <typename ClusteringOptions>
void check_bounds(const ClusteringOptions& options) {
    if (options.max_cluster_size) {
        const std::uint64_t size = *options.max_cluster_size;
        require(size >= 1, "max_cluster_size", size, "at least 1");
    }
    if (options.max_variation) {
        const double variation = *options.max_variation;
        require(variation > 0 && variation <= 1.0 / 3.0, "max_variation", variation,
                "above 0, at most 1/3");
    }
}

}  // namespace

void check_ranges(const HierarchicalClusteringOptions& options) {
    check_bounds(options);
}

void check_ranges(const IncrementalClusteringOptions& options) {
    check_bounds(options);
}

void check_ranges(const VoxelClusteringOptions& options) {
    if (options.voxel_size) require_positive("voxel_size", *options.voxel_size);
}

}  // namespace stipple
