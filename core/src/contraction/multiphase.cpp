#include "stipple/multiphase.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "cloud/cloud_copy.hpp"
#include "clustering/cluster_tree.hpp"
#include "clustering/representatives.hpp"
#include "contraction/contraction_options.hpp"
#include "contraction/multiphase_runs.hpp"
#include "contraction/sample_quadrics.hpp"
#include "contraction/sibling_contraction.hpp"
#include "contraction/surface_fit.hpp"

#include <algorithm>
#include <functional>
#include <numeric>
#include <optional>
#include <utility>

// Follows: Garland and Shaffer 2002 (cluster, then contract with the quadrics of the clusters);
// Pauly, Gross, Kobbelt 2002, §3.1 and §3.2 (both phases on points).
//
// Pairs are contracted only where they are the halves of a cluster (sibling_contraction.hpp).

namespace stipple {

namespace {

/// Fits the surface to the samples of each new point. Where few points are left of many, it takes
/// little of the time to do it well.
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

void check(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
           const MultiphaseOptions& options) {
    check_ranges(options);
    check_contraction(cloud, options.contraction);
    if (std::ranges::find(sizes, 0U) != sizes.end()) refuse("size 0: expected at least 1");
}

/// Samples of the first phase: as many as the options say, and as there are points.
std::uint64_t sample_count(const PointCloud& cloud, std::uint64_t size,
                           const MultiphaseOptions& options) {
    return static_cast<std::uint64_t>(std::min(static_cast<double>(cloud.size()),
                                               options.oversampling * static_cast<double>(size)));
}

/// The samples of a cut, and their contraction.
class SecondPhase {
public:
    /// @param members  of the tree; they and the rest stay alive.
    SecondPhase(const PointCloud& cloud, std::span<const Index> members, const Cut& cut,
                const IterativeSimplificationOptions& options, const RunContext& context)
        : cloud_(cloud),
          members_(members),
          cut_(cut),
          options_(options),
          samples_(cloud.positions, {members.data(), cut.offsets}, options.k,
                   Features(cloud, options), context),
          contraction_(samples_, cut.clusters_of, context) {}

    /// @param size  at most as many as there are samples.
    PointCloud cloud_of(std::uint64_t size, const RunContext& context) const {
        const std::vector<Index> first = contraction_.nodes_left(size, context);
        auto offsets = made_in_blocks<std::vector<Index>>(size + 1, context);
        for_blocks_in_order(size + 1, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) offsets[i] = cut_.offsets[first[i]];
        });
        auto positions = made_in_blocks<std::vector<Vec3f>>(size, context);
        parallel_for_blocks(size, 256, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                positions[i] = contraction_.place_of(first[i], first[i + 1]);
        });
        const MemberLists clusters = {members_.data(), offsets};
        if (options_.placement == Placement::Optimal)
            return fitted(clusters, first, std::move(positions), context);
        const auto nearest = nearest_members(cloud_.positions, clusters, positions, context);
        for (std::size_t i = 0; i < size; ++i) positions[i] = cloud_.positions[nearest[i]];
        return merged_cloud(cloud_, std::move(positions), clusters, nearest,
                            reductions_for(cloud_, options_.reductions, Representative::Nearest),
                            context);
    }

private:
    /// The surface is fitted to samples, not to points of the cloud: of noise they have little
    /// left, being means.
    /// @param first  samples of the clusters, and the end of the last.
    PointCloud fitted(const MemberLists& clusters, std::span<const Index> first,
                      std::vector<Vec3f> positions, const RunContext& context) const {
        std::vector<Index> numbers(samples_.size());
        std::iota(numbers.begin(), numbers.end(), Index{0});
        fit(positions, samples_.positions(), {numbers.data(), first}, cloud_.size(), context);
        if (options_.max_displacement) {
            bound_displacement(positions, cloud_.positions,
                               NeighborSearch(cloud_.positions, context),
                               *options_.max_displacement, context);
        }
        return merged_cloud(cloud_, std::move(positions), clusters, options_.reductions, context);
    }

    const PointCloud& cloud_;
    std::span<const Index> members_;
    const Cut& cut_;
    const IterativeSimplificationOptions& options_;
    QuadricSamples samples_;
    SiblingContraction contraction_;
};

}  // namespace

PointCloud multiphase(const PointCloud& cloud, const MultiphaseOptions& options,
                      const RunContext& context) {
    require_cleaned(cloud);
    const std::uint64_t size = options.contraction.target_size;
    if (size == 0) refuse("target_size 0: expected at least 1");
    const std::span sizes(&size, 1);
    return MultiphaseRuns(cloud, sizes, options, context.part(0, 0.4))
        .run(size, context.part(0.4, 1));
}

void multiphase_snapshots(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                          const MultiphaseOptions& options,
                          const std::function<void(PointCloud&&)>& on_cloud,
                          const RunContext& context) {
    check(cloud, sizes, options);
    std::uint64_t largest = 0;  // of those that need a run at all
    for (const std::uint64_t size : sizes)
        if (size < cloud.size()) largest = std::max(largest, size);
    context.checkpoint(0.0);
    std::vector<Index> members;
    Cut cut;
    std::optional<SecondPhase> phase;
    if (largest > 0) {
        ClusterTree tree(cloud.positions);
        cut = tree.cut(sample_count(cloud, largest, options), context.part(0, 0.4));
        members.assign(tree.members().begin(), tree.members().end());
    }
    context.checkpoint(0.4);
    if (largest > 0) phase.emplace(cloud, members, cut, options.contraction, context);
    context.checkpoint(0.8);
    for (const std::uint64_t size : sizes)
        on_cloud(size < cloud.size() ? phase->cloud_of(size, context) : copy_of(cloud, context));
    context.checkpoint(1.0);
}

MultiphaseRuns::MultiphaseRuns(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                               const MultiphaseOptions& options, const RunContext& context)
    : cloud_(cloud), options_(options) {
    check(cloud, sizes, options);
    std::vector<std::uint64_t> runs, samples;
    for (const std::uint64_t size : sizes)
        if (size < cloud.size()) runs.push_back(size);
    std::ranges::sort(runs, std::greater<>());
    context.checkpoint(0.0);
    if (runs.empty()) return;
    for (const std::uint64_t size : runs) samples.push_back(sample_count(cloud, size, options));
    ClusterTree tree(cloud.positions);
    std::vector<Cut> cuts = tree.cuts(samples, context);
    for (std::size_t i = 0; i < runs.size(); ++i)
        cuts_.insert_or_assign(runs[i], std::move(cuts[i]));
    members_.assign(tree.members().begin(), tree.members().end());
    context.checkpoint(1.0);
}

PointCloud MultiphaseRuns::run(std::uint64_t size, const RunContext& context) const {
    if (size >= cloud_.size()) return copy_of(cloud_, context);
    context.checkpoint(0.0);
    const SecondPhase phase(cloud_, members_, cuts_.at(size), options_.contraction, context);
    context.checkpoint(0.6);
    PointCloud result = phase.cloud_of(size, context);
    context.checkpoint(1.0);
    return result;
}

}  // namespace stipple
