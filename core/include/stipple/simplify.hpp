#pragma once

#include "stipple/hierarchical_clustering.hpp"
#include "stipple/incremental_clustering.hpp"
#include "stipple/multiphase.hpp"
#include "stipple/particle_simulation.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/voxel_clustering.hpp"

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace stipple {

enum class Method {
    Multiphase,    ///< cluster, then contract: the default (ours)
    Hierarchical,  ///< binary space partition (§3.1)
    Incremental,   ///< region growing (§3.1)
    Iterative,     ///< point-pair contraction (§3.2)
    Particles,     ///< repulsion on the surface (§3.3)
    Voxel,         ///< one point per cube of a grid: a baseline
    Random,        ///< a random subset: a baseline
};
inline constexpr std::array kMethods = {
    Method::Multiphase, Method::Hierarchical, Method::Incremental, Method::Iterative,
    Method::Particles,  Method::Voxel,        Method::Random};

/// `hierarchical`: the name in requests and on the command line.
std::string_view to_string(Method method) noexcept;
/// @throws Error(InvalidArgument) naming the available methods.
Method method_from_name(std::string_view name);

/// How to simplify a cloud: one method and one target. Only the options of that method are read.
struct SimplifyOptions {
    Method method = Method::Multiphase;
    std::optional<std::uint64_t> points{};  ///< N' >= 1: exactly this many; all if there are fewer
    std::optional<double>
        ratio{};  ///< in (0, 1]: exactly max(1, round(ratio * N)), N counted after cleaning
    std::optional<double> max_error{};      ///< > 0, input units: as few points as are found within
                                            ///< this error (`simplify_within_error`)
    std::optional<double> max_error_rel{};  ///< > 0: the same, as a fraction of the box's diagonal
    // The methods' own `target_size`, `seed` and `reductions` are set from the fields here.
    HierarchicalClusteringOptions hierarchical{};  ///< its bounds replace a target
    IncrementalClusteringOptions incremental{};    ///< its bounds replace a target; its
                                                   ///< `max_variation` also works beside one
    IterativeSimplificationOptions iterative{};    ///< also for `multiphase`
    double oversampling = MultiphaseOptions{}.oversampling;  ///< m of `multiphase`, 1..1000
    ParticleSimulationOptions particles{};
    VoxelClusteringOptions voxel{};  ///< its `voxel_size` replaces a target
    std::map<std::string, Reduction>
        reductions{};        ///< by attribute name, overriding the attribute's own; not for `random`
    std::uint64_t seed = 0;  ///< for methods that use random numbers
};

/// Checks what can be checked without a cloud: the target, and the range of every option of the
/// method.
/// @throws Error(InvalidArgument) with the option, its value and the limit.
void validate(const SimplifyOptions& options);

/// Simplifies a cleaned cloud (`clean`) by any method. The result has exactly the requested number
/// of points, or is the cloud itself if the target is not below its count; every attribute of the
/// input survives. Time and memory are those of the method.
/// @throws Error(InvalidArgument) for options out of range, a cloud without points, or one that was
/// not cleaned.
PointCloud simplify(const PointCloud& cloud, const SimplifyOptions& options,
                    const RunContext& context = {});

/// How to upsample a cloud: particles on the surface (§3.3, Fig. 12), one target.
struct UpsampleOptions {
    std::optional<std::uint64_t> points{};  ///< exactly this many; more than the cloud has
    std::optional<double> ratio{};  ///< above 1: exactly round(ratio * N), N counted after cleaning
    ParticleSimulationOptions particles{};  ///< `target_size` is set from the target
};

/// Checks what can be checked without a cloud.
/// @throws Error(InvalidArgument).
void validate(const UpsampleOptions& options);

/// Replaces the points of a cleaned cloud by more points on the same surface
/// (`particle_simulation`).
/// @throws Error(InvalidArgument) for options out of range, a cloud without points, or a target not
/// above their count.
PointCloud upsample(const PointCloud& cloud, const UpsampleOptions& options,
                    const RunContext& context = {});

}  // namespace stipple
