#include "stipple/iterative_simplification.hpp"

#include "base/first_touch.hpp"
#include "base/large_memory.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "cloud/cloud_copy.hpp"
#include "clustering/representatives.hpp"
#include "contraction/contraction.hpp"
#include "contraction/contraction_options.hpp"
#include "contraction/curvature_contraction.hpp"
#include "contraction/iterative_levels.hpp"
#include "contraction/level_bases.hpp"
#include "contraction/surface_fit.hpp"
#include "stipple/clusters.hpp"
#include "stipple/neighbors.hpp"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

// Follows: Pauly, Gross, Kobbelt 2002, §3.2. The contraction itself is in contraction.cpp.

namespace stipple {

namespace {

constexpr std::size_t kBlock = 65'536;

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
Clusters clusters_of(std::span<const Index> survivor_of, std::size_t survivors,
                     const RunContext& context) {
    Clusters clusters;
    clusters.offsets.assign(survivors + 1, 0);
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

/// Fits the survivors to the surface of what they were contracted from.
void fit(ContractionSnapshot& snapshot, std::span<const Vec3f> from, const Clusters& clusters,
         const RunContext& context) {
    const SurfaceFit how = fit_of(from.size(), snapshot.positions.size());
    const MemberLists lists = {clusters.members.data(), clusters.offsets};
    for (unsigned step = 0; step < kFits; ++step) {
        fit_surface(snapshot.positions, from, lists, how, context);
        return_freed_memory();
        context.checkpoint(static_cast<double>(step + 1) / kFits);
    }
}

/// Gives the levels that are the whole cloud. @return the other sizes.
/// @throws Error(InvalidArgument) for an option or a size out of range.
std::span<const std::uint64_t> smaller(const PointCloud& cloud,
                                       std::span<const std::uint64_t> sizes,
                                       const IterativeSimplificationOptions& options,
                                       const std::function<void(PointCloud&&)>& on_cloud,
                                       const RunContext& context) {
    check_contraction(cloud, options);
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        const std::uint64_t most = i == 0 ? cloud.size() : sizes[i - 1];
        if (sizes[i] < 1 || sizes[i] > most) {
            refuse("size ", sizes[i], ": expected 1..", most, ", descending");
        }
    }
    for (; !sizes.empty() && sizes.front() == cloud.size(); sizes = sizes.subspan(1))
        on_cloud(copy_of(cloud, context));
    return sizes;
}

/// For each point of the input, what stands for its survivor.
std::vector<Index> followed(std::span<const Index> survivor_of, std::span<const Index> later,
                            const RunContext& context) {
    auto last = made_in_blocks<std::vector<Index>>(survivor_of.size(), context);
    parallel_for_blocks(last.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) last[i] = later[survivor_of[i]];
    });
    return last;
}

/// Contracts a cloud to levels, and one of these to more.
class LevelMaker {
public:
    /// All but the context stay; none changes.
    LevelMaker(const PointCloud& cloud, const IterativeSimplificationOptions& options,
               const std::function<void(PointCloud&&)>& on_cloud, const RunContext& context)
        : cloud_(cloud), options_(options), on_cloud_(on_cloud) {
        if (options.max_displacement && options.placement == Placement::Optimal)
            search_.emplace(cloud.positions, context);
    }

    /// Makes the levels of a base: the cloud, and after that the next base of those before.
    void make(const LevelsOfBase& levels, const RunContext& context) {
        std::optional<Base> next;
        const auto on_snapshot = [&](ContractionSnapshot&& snapshot, const RunContext& run) {
            const bool is_next = snapshot.positions.size() == levels.next_base;
            if (is_next) next = {snapshot.positions, std::move(snapshot.quadrics), {}};
            PointCloud level = level_of(snapshot, run);
            if (is_next) next->survivor_of = std::move(snapshot.survivor_of);
            on_cloud_(std::move(level));
        };
        contract(levels, on_snapshot, context);
        base_ = std::move(next);
    }

private:
    struct Base {
        std::vector<Vec3f> positions;  ///< of a level, before they were fitted
        std::vector<StoredQuadric> quadrics;
        std::vector<Index> survivor_of;  ///< for each point of the cloud, that which stands for it
    };

    void contract(const LevelsOfBase& levels, const OnContracted& on_snapshot,
                  const RunContext& context) const {
        ContractionOptions options = {.k = options_.k, .placement = options_.placement};
        if (base_) {
            return contract_by_curvature(
                {base_->positions, base_->quadrics, cloud_.size(), levels.next_base}, levels.sizes,
                options, on_snapshot, context);
        }
        const Features features(cloud_, options_);
        options.features = features.values;
        options.channels = features.channels;
        if (options_.placement == Placement::Optimal) {
            return contract_by_curvature({.positions = cloud_.positions, .next = levels.next_base},
                                         levels.sizes, options, on_snapshot, context);
        }
        stipple::contract(
            cloud_.positions, {}, levels.sizes, options,
            [&](ContractionSnapshot&& snapshot) {
                on_snapshot(std::move(snapshot), context.quietly());
            },
            context);
    }

    /// Takes the positions; what is left says what stands for each point of the cloud.
    PointCloud level_of(ContractionSnapshot& snapshot, const RunContext& context) const {
        const std::span<const Vec3f> from = base_ ? base_->positions : cloud_.positions;
        const std::size_t survivors = snapshot.positions.size();
        Clusters clusters = clusters_of(snapshot.survivor_of, survivors, context);
        if (options_.placement == Placement::Optimal) fit(snapshot, from, clusters, context);
        if (base_) {
            snapshot.survivor_of = followed(base_->survivor_of, snapshot.survivor_of, context);
            clusters = clusters_of(snapshot.survivor_of, survivors, context);
        }
        const MemberLists lists = {clusters.members.data(), clusters.offsets};
        if (options_.placement == Placement::EndPoint) {
            const auto reductions =
                reductions_for(cloud_, options_.reductions, Representative::Nearest);
            return merged_cloud(cloud_, std::move(snapshot.positions), lists, snapshot.samples,
                                reductions, context);
        }
        if (search_) {
            bound_displacement(snapshot.positions, cloud_.positions, *search_,
                               *options_.max_displacement, context);
        }
        return merged_cloud(cloud_, std::move(snapshot.positions), lists, options_.reductions,
                            context);
    }

    const PointCloud& cloud_;
    const IterativeSimplificationOptions& options_;
    const std::function<void(PointCloud&&)>& on_cloud_;
    std::optional<NeighborSearch> search_;  ///< of the cloud's points, where displacements are
                                            ///< bounded
    std::optional<Base> base_;              ///< none: the cloud
};

}  // namespace

PointCloud iterative_simplification(const PointCloud& cloud,
                                    const IterativeSimplificationOptions& options,
                                    const RunContext& context) {
    require_cleaned(cloud);
    if (options.target_size == 0) {
        refuse("target_size 0: expected at least 1");
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
    sizes = smaller(cloud, sizes, options, on_cloud, context);
    if (sizes.empty()) return;
    LevelMaker(cloud, options, on_cloud, context).make({sizes}, context);
}

void iterative_levels(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                      const IterativeSimplificationOptions& options,
                      const std::function<void(PointCloud&&)>& on_cloud,
                      const RunContext& context) {
    // One run gives subsets anyway.
    if (options.placement == Placement::EndPoint)
        return iterative_snapshots(cloud, sizes, options, on_cloud, context);
    sizes = smaller(cloud, sizes, options, on_cloud, context);
    if (sizes.empty()) return;
    LevelMaker maker(cloud, options, on_cloud, context);
    for_each_base(
        cloud.size(), sizes, context,
        [&](const LevelsOfBase& levels, const RunContext& run) { maker.make(levels, run); });
}

}  // namespace stipple
