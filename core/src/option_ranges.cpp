#include "option_ranges.hpp"

#include "particle_density.hpp"
#include "refuse.hpp"

#include <cmath>
#include <cstdint>
#include <string>

namespace stipple {

namespace {

void require_not_negative(const std::string& name, double value) {
    require(value >= 0 && std::isfinite(value), name, value, "a finite number, at least 0");
}

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

void require_positive(const std::string& name, double value) {
    require(value > 0 && std::isfinite(value), name, value, "a finite number above 0");
}

void check_ranges(const HierarchicalClusteringOptions& options) {
    check_bounds(options);
}

void check_ranges(const IncrementalClusteringOptions& options) {
    check_bounds(options);
}

void check_ranges(const IterativeSimplificationOptions& options) {
    require(options.k >= 3 && options.k <= 32, "k", options.k, "3..32");
    if (options.max_displacement) {
        require_not_negative("max_displacement", *options.max_displacement);
    }
    require_not_negative("color_weight", options.color_weight);
    for (const auto& [name, weight] : options.attribute_weights) {
        require_not_negative("attribute_weights." + name, weight);
    }
}

void check_ranges(const MultiphaseOptions& options) {
    require(options.oversampling >= 1 && options.oversampling <= 1000, "oversampling",
            options.oversampling, "1 to 1000");
    check_ranges(options.contraction);
}

void check_ranges(const ParticleSimulationOptions& options) {
    require(options.adaptivity >= 0 && options.adaptivity <= 1, "adaptivity", options.adaptivity,
            "0 to 1");
    require(options.max_grading >= 1 && std::isfinite(options.max_grading), "max_grading",
            options.max_grading, "a finite number, at least 1");
    check_ranges(options.regions);
    require(options.max_iterations >= 1, "max_iterations", options.max_iterations, "at least 1");
    require(options.tolerance > 0 && options.tolerance < 1, "tolerance", options.tolerance,
            "above 0, below 1");
}

void check_ranges(const VoxelClusteringOptions& options) {
    if (options.voxel_size) require_positive("voxel_size", *options.voxel_size);
}

}  // namespace stipple
