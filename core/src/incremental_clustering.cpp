#include "stipple/incremental_clustering.hpp"

#include "cloud_copy.hpp"
#include "cluster_splitting.hpp"
#include "first_touch.hpp"
#include "incremental_levels.hpp"
#include "level_bases.hpp"
#include "parallel_for.hpp"
#include "random.hpp"
#include "refuse.hpp"
#include "region_growing.hpp"
#include "representatives.hpp"
#include "stray_points.hpp"
#include "until_stopped.hpp"

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
// Where clusters have fewer points in the mean than the first, they are split from regions of the
// second and more: small regions take twice as long, and those in sparse places are all strays.
constexpr std::uint64_t kSmall = 8, kRegion = 24;

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
    if (options.max_cluster_size && *options.max_cluster_size == 0) {
        refuse("max_cluster_size 0: expected at least 1");
    }
    if (options.max_variation) {
        const double variation = *options.max_variation;
        require(variation > 0 && variation <= 1.0 / 3.0, "max_variation", variation,
                "above 0, at most 1/3");
    }
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

/// Clusters of clusters, as clusters of their points.
Clusters joined(const Clusters& small, const Clusters& of_small, const RunContext& context) {
    Clusters large{made_in_blocks<std::vector<Index>>(small.members.size(), context),
                   of_small.offsets};
    auto to = large.members.begin();
    for_blocks_in_order(of_small.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            large.offsets[i] = static_cast<Index>(to - large.members.begin());
            for (const Index cluster : of_small.of(i))
                to = std::ranges::copy(small.of(cluster), to).out;
        }
    });
    large.offsets.back() = static_cast<Index>(large.members.size());
    return large;
}

/// A level of which coarser ones are made.
struct Base {
    std::vector<Vec3f> points;
    Clusters clusters;  ///< of the input's points, one for each
};

/// How many regions are to grow for so many clusters: a half, a quarter, ... where these are small.
std::uint64_t regions_for(std::uint64_t clusters, std::uint64_t points) {
    if (points / clusters >= kSmall) return clusters;
    while (clusters > 1 && points / clusters < kRegion) clusters /= 2;
    return clusters;
}

/// Of points, exactly as many clusters as are wanted.
Clusters clusters_of(std::span<const Vec3f> points, const IncrementalClusteringOptions& options,
                     const RunContext& context) {
    if (!options.target_size) return incremental_clusters(points, options, context);
    IncrementalClusteringOptions grown = options;
    if (!options.max_variation)
        grown.target_size = regions_for(*options.target_size, points.size());
    constexpr double kGrown = 0.8;
    Clusters clusters = incremental_clusters(points, grown, context.part(0, kGrown));
    split_clusters(points, *options.target_size, clusters, context);
    return clusters;
}

}  // namespace

Clusters incremental_clusters(std::span<const Vec3f> points,
                              const IncrementalClusteringOptions& options,
                              const RunContext& context) {
    check(options, points.size());
    std::optional<std::uint64_t> target = options.target_size;
    if (target) target = std::min<std::uint64_t>(*target, points.size());
    const Grown grown = grow(points, options, target, context.part(0.0, 0.8));
    const std::size_t count = target.value_or(grown.far_enough);
    return with_strays_joined(points, grown.regions, chosen_regions(grown, count, context),
                              context.part(0.8, 1.0));
}

PointCloud incremental_clustering(const PointCloud& cloud,
                                  const IncrementalClusteringOptions& options,
                                  const RunContext& context) {
    validate(cloud);
    check(options, cloud.size());
    if (options.target_size && *options.target_size >= cloud.size()) return copy_of(cloud, context);
    const std::vector<Reduction> reductions =
        reductions_for(cloud, options.reductions, options.representative);
    const Clusters clusters = clusters_of(cloud.positions, options, context.part(0.0, 0.8));
    context.checkpoint(0.85);
    PointCloud result = representatives(cloud, {clusters.members.data(), clusters.offsets},
                                        options.representative, reductions, context);
    context.checkpoint(1.0);
    return result;
}

void incremental_levels(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                        const IncrementalClusteringOptions& options,
                        const std::function<void(PointCloud&&)>& on_cloud,
                        const RunContext& context) {
    const std::vector<Reduction> reductions =
        reductions_for(cloud, options.reductions, options.representative);
    for (; !sizes.empty() && sizes.front() == cloud.size(); sizes = sizes.subspan(1))
        on_cloud(copy_of(cloud, context));
    std::optional<Base> base;  // else the cloud
    const auto make = [&](const LevelsOfBase& levels, const RunContext& run) {
        const std::span<const Vec3f> points = base ? base->points : cloud.positions;
        const double each = 1.0 / static_cast<double>(levels.sizes.size());
        std::optional<Base> next;
        double done = 0;
        for (const std::uint64_t size : levels.sizes) {
            IncrementalClusteringOptions one = options;
            one.target_size = size;
            const double before = std::exchange(done, std::min(1.0, done + each));
            Clusters clusters = clusters_of(points, one, run.part(before, done));
            if (base) clusters = joined(base->clusters, clusters, context);
            PointCloud level = representatives(cloud, {clusters.members.data(), clusters.offsets},
                                               options.representative, reductions, context);
            if (size == levels.next_base) next = {level.positions, std::move(clusters)};
            on_cloud(std::move(level));
        }
        base = std::move(next);
    };
    if (options.max_variation)
        make({sizes}, context);
    else
        for_each_base(cloud.size(), sizes, context, make);
    context.checkpoint(1.0);
}

}  // namespace stipple
