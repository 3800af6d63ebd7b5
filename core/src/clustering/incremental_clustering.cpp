#include "stipple/incremental_clustering.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/random.hpp"
#include "base/refuse.hpp"
#include "base/until_stopped.hpp"
#include "cloud/cloud_copy.hpp"
#include "clustering/cluster_splitting.hpp"
#include "clustering/cluster_tree.hpp"
#include "clustering/clustering_options.hpp"
#include "clustering/gather.hpp"
#include "clustering/incremental_levels.hpp"
#include "clustering/region_growing.hpp"
#include "clustering/representatives.hpp"
#include "clustering/stray_points.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

// Follows: Pauly, Gross, Kobbelt 2002, §3.1. The paper reaches a given number of clusters by trial;
// here the threshold for strays, "typically half", is what is left free: of the regions grown, as
// many as are wanted are kept.

namespace stipple {

namespace {

constexpr double kStray = 0.5;  // of the bounds

void check(const IncrementalClusteringOptions& options, std::size_t points) {
    if (points == 0) refuse("the cloud has no points: expected at least 1");
    if (!options.target_size && !options.max_cluster_size && !options.max_variation) {
        refuse("incremental: expected a target size, max_cluster_size or max_variation");
    }
    if (options.target_size && options.max_cluster_size) {
        refuse("incremental: a target size excludes max_cluster_size; remove one");
    }
    if (options.target_size && *options.target_size == 0) {
        refuse("target_size 0: expected 1..", points);
    }
    check_ranges(options);
}

/// How far a region came: at least 1 where it reached a bound.
double reached(const Region& region, const RegionBounds& bounds) {
    const double size = static_cast<double>(region.size()) / static_cast<double>(bounds.max_size);
    return region.is_bent ? 1 + size : std::max(size, region.variation / bounds.max_variation);
}

/// Regions and which of them are clusters; the points of the others are strays.
struct Grown {
    Regions regions;
    RegionBounds bounds;
    std::size_t far_enough = 0;  ///< regions that reached half of a bound
};

Grown grow(PointBlocks& blocks, const RegionBounds& bounds, std::uint64_t seed,
           const RunContext& context) {
    Grown grown{grow_regions(blocks, bounds, seed, context), bounds, 0};
    const std::span<const Region> regions = grown.regions.regions;
    for_blocks_in_order(regions.size(), context, [&](std::size_t begin, std::size_t end) {
        grown.far_enough += static_cast<std::size_t>(std::ranges::count_if(
            regions.subspan(begin, end - begin),
            [&](const Region& region) { return reached(region, bounds) >= kStray; }));
    });
    return grown;
}

/// Bounds that are to give a number of clusters.
class BoundsForTarget {
public:
    BoundsForTarget(double mean_size, double max_variation)
        : mean_size_(mean_size), size_(mean_size), max_variation_(max_variation) {}

    RegionBounds bounds() const {
        return {std::max<std::uint64_t>(2, std::llround(size_)), max_variation_};
    }
    /// Learns that there were so many, of those wanted. @return whether it makes a difference.
    bool correct(double share) {
        constexpr double kLargest = 1.5;  // n_max over the mean size
        const RegionBounds before = bounds();
        size_ = std::clamp(size_ * share, 1.0, kLargest * mean_size_);
        if (share > 1) max_variation_ *= share;
        return bounds().max_size != before.max_size || max_variation_ != before.max_variation;
    }

private:
    double mean_size_, size_, max_variation_;
};

/// Bounds of which some regions tried say that there will be about `target`, or few more.
BoundsForTarget guess(PointBlocks& blocks, std::uint64_t target, double max_variation,
                      const RunContext& context) {
    const auto wanted = static_cast<double>(target);
    BoundsForTarget guess(static_cast<double>(blocks.samples().size) / wanted, max_variation);
    if (!std::isfinite(max_variation)) return guess;
    // Of regions that grow beside others more are bent, and fewer come far, than of those tried.
    constexpr double kFarEnough = 0.67, kFew = 1.15, kNotMany = 2;
    constexpr int kMostGuesses = 6;
    for (int i = 0; i < kMostGuesses; ++i) {
        const double share =
            kFarEnough * estimated_regions(blocks, guess.bounds(), context) / wanted;
        if (share <= kFew || !guess.correct(share) || share <= kNotMany) break;
    }
    return guess;
}

/// Looks for bounds that give about `target` clusters, where that many, and not many more, are no
/// strays.
Grown search(PointBlocks& blocks, std::uint64_t target, double max_variation, std::uint64_t seed,
             const RunContext& context) {
    constexpr int kMostRuns = 3;
    constexpr double kFewest = 0.6, kMost = 1.6;  // regions far enough, of the target
    BoundsForTarget guessed = guess(blocks, target, max_variation, context);
    double from = 0;
    for (int run = 1;; ++run) {
        const double to = run == kMostRuns ? 1.0 : 0.5 * (1.0 + from);
        Grown grown = grow(blocks, guessed.bounds(), seed, context.part(from, to));
        const double share = static_cast<double>(grown.far_enough) / static_cast<double>(target);
        const bool enough = grown.regions.regions.size() >= target;
        const bool fits = enough && share >= kFewest && share <= kMost;
        if (run == kMostRuns || fits || !guessed.correct(share)) return grown;
        blocks.free_all(context);
        from = to;
    }
}

/// The regions that the options ask for. A target is at most the number of points.
Grown grow(std::span<const Vec3f> points, const IncrementalClusteringOptions& options,
           std::optional<std::uint64_t> target, const RunContext& context) {
    constexpr double kUnbounded = std::numeric_limits<double>::infinity();
    RegionBounds bounds = {.max_size = options.max_cluster_size.value_or(points.size()),
                           .max_variation = options.max_variation.value_or(kUnbounded)};
    if (target) bounds.max_size = points.size() / *target;
    PointBlocks blocks = blocks_for_regions(points, bounds, context);
    if (target) return search(blocks, *target, bounds.max_variation, options.seed, context);
    return grow(blocks, bounds, options.seed, context);
}

/// The numbers of the regions that are clusters, ascending: the `count` that came farthest; among
/// equals anywhere, not those that were grown first, which lie together.
std::vector<Index> chosen_regions(const Grown& grown, std::size_t count,
                                  const RunContext& context) {
    struct Ranked {
        double reached;
        std::uint64_t lot;
        Index region;
    };
    const std::vector<Region>& regions = grown.regions.regions;
    auto ranked = made_in_blocks<std::vector<Ranked>>(regions.size(), context);
    for_blocks_in_order(regions.size(), context, [&](std::size_t begin, std::size_t end) {
        for (auto i = static_cast<Index>(begin); i < end; ++i)
            ranked[i] = {reached(regions[i], grown.bounds), random_bits(0, i), i};
    });
    count = std::clamp<std::size_t>(count, 1, ranked.size());
    std::ranges::nth_element(ranked, ranked.begin() + static_cast<std::ptrdiff_t>(count) - 1,
                             until_stopped(context, std::greater<>()),
                             [](const Ranked& r) { return std::pair(r.reached, r.lot); });
    std::vector<char> is_chosen(regions.size());
    for (const Ranked& r : std::span(ranked).first(count)) is_chosen[r.region] = 1;
    std::vector<Index> chosen;
    chosen.reserve(count);
    for_blocks_in_order(regions.size(), context, [&](std::size_t begin, std::size_t end) {
        for (auto i = static_cast<Index>(begin); i < end; ++i)
            if (is_chosen[i] != 0) chosen.push_back(i);
    });
    return chosen;
}

/// Of the clusters, the share that is wider than twice the median: of some of them.
double share_of_wide(std::span<const Vec3f> points, const Clusters& clusters) {
    constexpr std::size_t kAsked = 4'096;
    constexpr double kWide = 2;
    const std::size_t stride = (clusters.size() + kAsked - 1) / kAsked;
    std::vector<double> widths;
    Gathered gathered(points);
    for (std::size_t i = 0; i < clusters.size(); i += stride)
        widths.push_back(width_of_cluster(gathered.moments_of(clusters.of(i)), {}));
    const auto middle = widths.begin() + static_cast<std::ptrdiff_t>(widths.size() / 2);
    std::ranges::nth_element(widths, middle);
    const auto wide = std::ranges::count_if(
        widths, [limit = kWide * *middle](double width) { return width > limit; });
    return static_cast<double>(wide) / static_cast<double>(widths.size());
}

/// Exactly so many clusters. Those that strays make wide are split, and as many fewer are grown.
Clusters clusters_of(std::span<const Vec3f> points, const Grown& grown, std::uint64_t target,
                     const RunContext& context) {
    constexpr double kFew = 0.01, kMost = 0.2;
    const auto joined = [&](std::uint64_t count) {
        return with_strays_joined(points, grown.regions, chosen_regions(grown, count, context),
                                  context);
    };
    Clusters clusters = joined(target);
    const double wide = std::min(kMost, share_of_wide(points, clusters));
    if (wide >= kFew) {
        const double others = (1 - wide) * static_cast<double>(target);
        clusters = joined(static_cast<std::uint64_t>(std::ceil(others)));
    }
    split_clusters(points, target, clusters, context);
    return clusters;
}

}  // namespace

bool are_split(std::uint64_t clusters, std::uint64_t points,
               const IncrementalClusteringOptions& options) {
    return !options.max_variation && points / clusters < kPointsToGrow;
}

Clusters incremental_clusters(std::span<const Vec3f> points,
                              const IncrementalClusteringOptions& options,
                              const RunContext& context) {
    check(options, points.size());
    std::optional<std::uint64_t> target = options.target_size;
    if (target) target = std::min<std::uint64_t>(*target, points.size());
    if (target && are_split(*target, points.size(), options)) {
        ClusterTree tree(points, width_of_cluster);
        std::vector<Index> offsets = tree.cut(*target, context).offsets;
        return {{tree.members().begin(), tree.members().end()}, std::move(offsets)};
    }
    const RunContext quiet = context.quietly();
    const Grown grown = grow(points, options, target, context.part(0.0, 0.8));
    if (target && !options.max_variation) return clusters_of(points, grown, *target, quiet);
    Clusters clusters =
        with_strays_joined(points, grown.regions,
                           chosen_regions(grown, target.value_or(grown.far_enough), quiet), quiet);
    if (target) split_clusters(points, *target, clusters, quiet);
    return clusters;
}

PointCloud incremental_clustering(const PointCloud& cloud,
                                  const IncrementalClusteringOptions& options,
                                  const RunContext& context) {
    require_cleaned(cloud);
    check(options, cloud.size());
    const Reductions reductions = reductions_for(cloud, options.reductions, options.representative);
    if (options.target_size && *options.target_size >= cloud.size()) return copy_of(cloud, context);
    const Clusters clusters =
        incremental_clusters(cloud.positions, options, context.part(0.0, 0.8));
    context.checkpoint(0.85);
    PointCloud result = representatives(cloud, {clusters.members.data(), clusters.offsets},
                                        options.representative, reductions, context);
    context.checkpoint(1.0);
    return result;
}

}  // namespace stipple
