#include "stipple/iterative_simplification.hpp"

#include "cloud_copy.hpp"
#include "contraction.hpp"
#include "contraction_options.hpp"
#include "curvature_contraction.hpp"
#include "large_memory.hpp"
#include "parallel_for.hpp"
#include "representatives.hpp"
#include "stipple/clusters.hpp"
#include "stipple/error.hpp"
#include "stipple/neighbors.hpp"
#include "surface_fit.hpp"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

// Follows: Pauly, Gross, Kobbelt 2002, §3.2. The contraction itself is in contraction.cpp.

namespace stipple {

namespace {

/// Steps in which points are fitted to the surface.
constexpr unsigned kFits = 3;

/// How: far in each step, but not beyond edges, and so that what closer points gain is shared
/// between the linear and the quadratic surface. From 4 to 8 input points of each new one count, so
/// that it costs a small part of the time.
SurfaceFit fit_of(std::size_t input, std::size_t size) {
    return {.asked = static_cast<unsigned>(std::clamp<std::size_t>(input / (6 * size), 4, 8)),
            .close = 0.6F,
            .damping = 0.25F,
            .farthest_move = 0.1F};
}

/// The samples of each survivor, in their order.
Clusters clusters_of(const ContractionSnapshot& snapshot, const RunContext& context) {
    const std::vector<Index>& survivor_of = snapshot.survivor_of;
    Clusters clusters;
    clusters.offsets.assign(snapshot.positions.size() + 1, 0);
    const auto for_samples = [&](auto&& body) {
        for_blocks_in_order(survivor_of.size(), context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) body(i);
        });
    };
    for_samples([&](std::size_t i) { ++clusters.offsets[survivor_of[i]]; });
    Index begin = 0;
    for (Index& offset : clusters.offsets) begin += std::exchange(offset, begin);
    clusters.members.resize(survivor_of.size());
    std::vector<Index> next = clusters.offsets;
    for_samples(
        [&](std::size_t i) { clusters.members[next[survivor_of[i]]++] = static_cast<Index>(i); });
    return clusters;
}

/// @param search  of the cloud's points, where displacements are bounded.
PointCloud cloud_of(const PointCloud& cloud, ContractionSnapshot&& snapshot,
                    const IterativeSimplificationOptions& options,
                    const std::optional<NeighborSearch>& search, const RunContext& context) {
    const Clusters clusters = clusters_of(snapshot, context);
    const MemberLists lists = {clusters.members.data(), clusters.offsets};
    if (options.placement == Placement::Optimal) {
        const SurfaceFit fit = fit_of(cloud.size(), snapshot.positions.size());
        for (unsigned step = 0; step < kFits; ++step) {
            fit_surface(snapshot.positions, cloud.positions, lists, fit, context);
            return_freed_memory();
        }
        if (search) {
            bound_displacement(snapshot.positions, cloud.positions, *search,
                               *options.max_displacement, context);
        }
        return merged_cloud(cloud, std::move(snapshot.positions), lists, options.reductions,
                            context);
    }
    const auto reductions = reductions_for(cloud, options.reductions, Representative::Nearest);
    return merged_cloud(cloud, std::move(snapshot.positions), lists, snapshot.samples, reductions,
                        true, context);
}

}  // namespace

PointCloud iterative_simplification(const PointCloud& cloud,
                                    const IterativeSimplificationOptions& options,
                                    const RunContext& context) {
    if (options.target_size == 0) {
        throw Error(ErrorCode::InvalidArgument, "target_size 0: expected at least 1");
    }
    check_contraction(cloud, options);
    if (options.target_size >= cloud.size()) return copy_of(cloud, context);
    PointCloud result;
    const std::uint64_t size = options.target_size;
    iterative_snapshots(
        cloud, std::span(&size, 1), options, [&](PointCloud&& c) { result = std::move(c); },
        context);
    context.checkpoint(1.0);
    return result;
}

void iterative_snapshots(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                         const IterativeSimplificationOptions& options,
                         const std::function<void(PointCloud&&)>& on_cloud,
                         const RunContext& context) {
    check_contraction(cloud, options);
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        const std::uint64_t most = i == 0 ? cloud.size() : sizes[i - 1];
        if (sizes[i] < 1 || sizes[i] > most) {
            throw Error(ErrorCode::InvalidArgument, "size " + std::to_string(sizes[i]) +
                                                        ": expected 1.." + std::to_string(most) +
                                                        ", descending");
        }
    }
    for (; !sizes.empty() && sizes.front() == cloud.size(); sizes = sizes.subspan(1))
        on_cloud(copy_of(cloud, context));
    if (sizes.empty()) return;
    const Features features(cloud, options);
    std::optional<NeighborSearch> search;
    if (options.max_displacement && options.placement == Placement::Optimal)
        search.emplace(cloud.positions, context);
    const ContractionOptions contraction = {.k = options.k,
                                            .placement = options.placement,
                                            .features = features.values,
                                            .channels = features.channels};
    const auto on_snapshot = [&](ContractionSnapshot&& snapshot) {
        on_cloud(cloud_of(cloud, std::move(snapshot), options, search, context));
    };
    if (options.placement == Placement::Optimal)
        contract_by_curvature(cloud.positions, sizes, contraction, on_snapshot, context);
    else
        contract(cloud.positions, {}, sizes, contraction, on_snapshot, context);
}

}  // namespace stipple
