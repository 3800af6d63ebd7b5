#include "stipple/multiphase.hpp"

#include "cloud_copy.hpp"
#include "cluster_tree.hpp"
#include "contraction_options.hpp"
#include "first_touch.hpp"
#include "parallel_for.hpp"
#include "representatives.hpp"
#include "sample_quadrics.hpp"
#include "sibling_contraction.hpp"
#include "stipple/error.hpp"
#include "surface_fit.hpp"

#include <algorithm>
#include <numeric>
#include <sstream>
#include <utility>

// Follows: Garland and Shaffer 2002 (cluster, then contract with the quadrics of the clusters);
// Pauly, Gross, Kobbelt 2002, §3.1 and §3.2 (both phases on points).
//
// Pairs are contracted only where they are the halves of a cluster (sibling_contraction.hpp).

namespace stipple {

namespace {

/// Fits the surface to the samples of each new point. Of many of them more count, as in coarse
/// levels of a pyramid, which take little of the time; and where few points are left of many, it
/// takes little of the time to do it well.
void fit(std::vector<Vec3f>& positions, std::span<const Vec3f> samples, const MemberLists& parts,
         std::size_t points, const RunContext& context) {
    constexpr std::size_t kMany = 50;  // points, for each that is left
    constexpr unsigned kMost = 4;
    const std::size_t size = positions.size();
    const bool well = points / size >= kMany;
    const std::size_t asked = std::clamp<std::size_t>(samples.size() / (2 * size), 2, kMost);
    const SurfaceFit options = {.asked = well ? kMost : static_cast<unsigned>(asked),
                                .in_order = true};
    for (int times = well ? 2 : 1; times > 0; --times)
        fit_surface(positions, samples, parts, options, context);
}

[[noreturn]] void refuse(const std::string& message) {
    throw Error(ErrorCode::InvalidArgument, message);
}

void check(const PointCloud& cloud, const MultiphaseOptions& options) {
    check_contraction(cloud, options.contraction);
    if (!(options.oversampling >= 1 && options.oversampling <= 1000)) {
        std::ostringstream text;
        text << "oversampling " << options.oversampling << ": expected 1..1000";
        refuse(text.str());
    }
}

/// Samples of the first phase: as many as the options say, and as there are points.
std::uint64_t sample_count(const PointCloud& cloud, std::uint64_t size,
                           const MultiphaseOptions& options) {
    return static_cast<std::uint64_t>(std::min(static_cast<double>(cloud.size()),
                                               options.oversampling * static_cast<double>(size)));
}

/// The cloud of a point for each of `clusters`. The surface is fitted to samples, not to points of
/// the cloud: of noise they have little left, being means.
/// @param parts  the samples of each cluster.
PointCloud cloud_at(const PointCloud& cloud, const Clusters& clusters, std::vector<Vec3f> positions,
                    std::span<const Vec3f> samples, const MemberLists& parts,
                    const IterativeSimplificationOptions& options, const RunContext& context) {
    if (options.placement == Placement::Optimal) {
        fit(positions, samples, parts, cloud.size(), context);
        if (options.max_displacement) {
            bound_displacement(positions, cloud.positions, NeighborSearch(cloud.positions, context),
                               *options.max_displacement, context);
        }
        return merged_cloud(cloud, clusters, std::move(positions), options.reductions, context);
    }
    const MemberLists lists = {clusters.members.data(), clusters.offsets};
    const auto nearest = nearest_members(cloud.positions, lists, positions, context);
    for (std::size_t i = 0; i < nearest.size(); ++i) positions[i] = cloud.positions[nearest[i]];
    return merged_cloud(cloud, std::move(positions), lists, nearest,
                        reductions_for(cloud, options.reductions, Representative::Nearest), true,
                        context);
}

}  // namespace

PointCloud multiphase(const PointCloud& cloud, const MultiphaseOptions& options,
                      const RunContext& context) {
    check(cloud, options);
    const std::uint64_t size = options.contraction.target_size;
    if (size == 0) refuse("target_size 0: expected at least 1");
    PointCloud result;
    multiphase_snapshots(
        cloud, std::span(&size, 1), options, [&](PointCloud&& c) { result = std::move(c); },
        context);
    return result;
}

void multiphase_snapshots(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                          const MultiphaseOptions& options,
                          const std::function<void(PointCloud&&)>& on_cloud,
                          const RunContext& context) {
    check(cloud, options);
    std::uint64_t largest = 0;  // of those that need a run at all
    for (const std::uint64_t size : sizes) {
        if (size == 0) refuse("size 0: expected at least 1");
        if (size < cloud.size()) largest = std::max(largest, size);
    }
    if (largest == 0) {
        for (std::size_t i = 0; i < sizes.size(); ++i) on_cloud(copy_of(cloud, context));
        return;
    }
    context.checkpoint(0.0);
    Clusters clusters;
    const Cut cut = [&] {
        ClusterTree tree(cloud.positions);
        Cut samples = tree.cut(sample_count(cloud, largest, options), context.part(0, 0.4));
        clusters.members.assign(tree.members().begin(), tree.members().end());
        return samples;
    }();
    context.checkpoint(0.4);
    const QuadricSamples samples(cloud.positions, {clusters.members.data(), cut.offsets},
                                 options.contraction.k, Features(cloud, options.contraction),
                                 context);
    const SiblingContraction contraction(samples, cut.clusters_of, context);
    context.checkpoint(0.8);
    std::vector<Index> numbers(samples.size());
    std::iota(numbers.begin(), numbers.end(), Index{0});
    for (const std::uint64_t size : sizes) {
        if (size >= cloud.size()) {
            on_cloud(copy_of(cloud, context));
            continue;
        }
        const std::vector<Index> first = contraction.nodes_left(size, context);
        auto positions = made_in_blocks<std::vector<Vec3f>>(size, context);
        clusters.offsets.resize(size + 1);
        for_blocks_in_order(size + 1, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) clusters.offsets[i] = cut.offsets[first[i]];
        });
        parallel_for_blocks(size, 256, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                positions[i] = contraction.place_of(first[i], first[i + 1]);
        });
        on_cloud(cloud_at(cloud, clusters, std::move(positions), samples.positions(),
                          {numbers.data(), first}, options.contraction, context));
    }
    context.checkpoint(1.0);
}

}  // namespace stipple
