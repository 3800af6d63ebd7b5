#include "stipple/simplify.hpp"

#include "base/refuse.hpp"
#include "cloud/cloud_copy.hpp"
#include "clustering/clustering_options.hpp"
#include "clustering/representatives.hpp"
#include "contraction/contraction_options.hpp"
#include "particles/particle_simulator.hpp"
#include "stipple/error_bounded.hpp"
#include "stipple/iterative_simplification.hpp"
#include "stipple/random_sampling.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stipple {

namespace {

/// Whether bounds of the method's own say how many points there will be.
bool has_bounds(const SimplifyOptions& options) {
    switch (options.method) {
        case Method::Hierarchical:
            return options.hierarchical.max_cluster_size || options.hierarchical.max_variation;
        case Method::Incremental: {
            // Beside a target, the variation shapes the clusters.
            const bool targeted = options.points || options.ratio;
            return options.incremental.max_cluster_size ||
                   (options.incremental.max_variation && !targeted);
        }
        case Method::Voxel:
            return options.voxel.voxel_size.has_value();
        default:
            return false;
    }
}

std::string expected_targets(Method method) {
    switch (method) {
        case Method::Hierarchical:
            return "exactly one of points, ratio, max_error, or max_cluster_size and/or "
                   "max_variation";
        case Method::Incremental:
            return "exactly one of points, ratio, or max_cluster_size and/or max_variation";
        case Method::Voxel:
            return "exactly one of points, ratio and voxel_size";
        case Method::Random:
            return "exactly one of points and ratio";
        default:
            return "exactly one of points, ratio and max_error";
    }
}

void check_own_options(const SimplifyOptions& options) {
    switch (options.method) {
        case Method::Multiphase:
            return check_ranges(MultiphaseOptions{options.oversampling, options.iterative});
        case Method::Hierarchical:
            return check_ranges(options.hierarchical);
        case Method::Incremental:
            return check_ranges(options.incremental);
        case Method::Iterative:
            return check_ranges(options.iterative);
        case Method::Particles:
            return check_ranges(options.particles);
        case Method::Voxel:
            return check_ranges(options.voxel);
        case Method::Random:
            if (!options.reductions.empty()) refuse("reductions: random keeps points as they are");
            return;
    }
}

std::uint64_t scaled(std::size_t points, double ratio) {
    const double wanted = std::round(ratio * static_cast<double>(points));
    constexpr double kMost = std::numeric_limits<Index>::max();
    require(wanted <= kMost, "ratio", ratio, "fewer than 2^32 points");
    return static_cast<std::uint64_t>(std::max(1.0, wanted));
}

/// The method's own options, with what is common to all of them.
template <typename Options>
Options with_common(Options own, const SimplifyOptions& options,
                    const std::optional<std::uint64_t>& target) {
    if (target) own.target_size = *target;
    if constexpr (requires { own.reductions; }) own.reductions = options.reductions;
    if constexpr (requires { own.seed; }) own.seed = options.seed;
    return own;
}

}  // namespace

std::string_view to_string(Method method) noexcept {
    switch (method) {
        case Method::Multiphase:
            return "multiphase";
        case Method::Hierarchical:
            return "hierarchical";
        case Method::Incremental:
            return "incremental";
        case Method::Iterative:
            return "iterative";
        case Method::Particles:
            return "particles";
        case Method::Voxel:
            return "voxel";
        case Method::Random:
            break;
    }
    return "random";
}

Method method_from_name(std::string_view name) {
    std::string offered;
    for (const Method method : kMethods) {
        if (name == to_string(method)) return method;
        offered += (offered.empty() ? "" : ", ") + std::string(to_string(method));
    }
    refuse("method ", name.substr(0, 60), ": expected one of ", offered);
}

void validate(const SimplifyOptions& options) {
    if (options.max_error) require_positive("max_error", *options.max_error);
    if (options.max_error_rel)
        require(*options.max_error_rel > 0 && std::isfinite(*options.max_error_rel), "max_error",
                *options.max_error_rel, "a finite fraction of the diagonal, above 0");
    const bool bounds_error = options.max_error || options.max_error_rel;
    if (bounds_error) require_error_bounded(options.method);
    const int targets = int{options.points.has_value()} + int{options.ratio.has_value()} +
                        int{options.max_error.has_value()} +
                        int{options.max_error_rel.has_value()} + int{has_bounds(options)};
    if (targets != 1) refuse("target: expected ", expected_targets(options.method));
    if (options.points) require(*options.points >= 1, "points", *options.points, "at least 1");
    if (options.ratio) {
        require(*options.ratio > 0 && *options.ratio <= 1, "ratio", *options.ratio,
                "above 0, at most 1");
    }
    check_own_options(options);
}

PointCloud simplify(const PointCloud& cloud, const SimplifyOptions& options,
                    const RunContext& context) {
    validate(options);
    require_cleaned(cloud);
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    if (options.max_error || options.max_error_rel)
        return simplify_within_error(cloud, options, context).cloud;
    std::optional<std::uint64_t> target = options.points;
    if (options.ratio) target = scaled(cloud.size(), *options.ratio);
    // Attributes that it names must be there, also where nothing is reduced.
    reductions_for(cloud, options.reductions, Representative::Centroid);
    if (target && *target >= cloud.size()) return copy_of(cloud, context);

    const auto own = [&](const auto& defaults) { return with_common(defaults, options, target); };
    switch (options.method) {
        case Method::Multiphase:
            return multiphase(cloud, {options.oversampling, own(options.iterative)}, context);
        case Method::Hierarchical:
            return hierarchical_clustering(cloud, own(options.hierarchical), context);
        case Method::Incremental:
            return incremental_clustering(cloud, own(options.incremental), context);
        case Method::Iterative:
            return iterative_simplification(cloud, own(options.iterative), context);
        case Method::Particles:
            return particle_simulation(cloud, own(options.particles), context);
        case Method::Voxel:
            return voxel_clustering(cloud, own(options.voxel), context);
        case Method::Random:
            break;
    }
    return random_sampling(cloud, own(RandomSamplingOptions{}), context);
}

void validate(const UpsampleOptions& options) {
    if (int{options.points.has_value()} + int{options.ratio.has_value()} != 1) {
        refuse("target: expected exactly one of points and ratio");
    }
    if (options.points) {
        require(*options.points >= 2 && *options.points <= std::numeric_limits<Index>::max(),
                "points", *options.points, "at least 2, fewer than 2^32");
    }
    if (options.ratio) {
        require(*options.ratio > 1 && std::isfinite(*options.ratio), "ratio", *options.ratio,
                "a finite number above 1");
    }
    check_ranges(options.particles);
}

PointCloud upsample(const PointCloud& cloud, const UpsampleOptions& options,
                    const RunContext& context) {
    validate(options);
    require_cleaned(cloud);
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    ParticleSimulationOptions particles = options.particles;
    particles.target_size = options.points ? *options.points : scaled(cloud.size(), *options.ratio);
    if (particles.target_size <= cloud.size()) {
        refuse("points ", particles.target_size, ": expected more than the ", cloud.size(),
               " of the cloud; simplify yields fewer");
    }
    return particle_simulation(cloud, particles, context);
}

}  // namespace stipple
