#include "stipple/incremental_clustering.hpp"

#include "cloud_copy.hpp"
#include "cluster_splitting.hpp"
#include "first_touch.hpp"
#include "parallel_for.hpp"
#include "random.hpp"
#include "region_growing.hpp"
#include "representatives.hpp"
#include "stipple/error.hpp"
#include "stray_points.hpp"
#include "until_stopped.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <sstream>
#include <vector>

// Follows: Pauly, Gross, Kobbelt 2002, §3.1. The paper reaches a given number of clusters by trial;
// here the threshold for strays, "typically half", is what is left free: of the regions grown, as
// many as are wanted are kept.

namespace stipple {

namespace {

constexpr double kStray = 0.5;  // of the bounds

void check(const IncrementalClusteringOptions& options, std::size_t points) {
    const auto refuse = [](const std::string& message) {
        throw Error(ErrorCode::InvalidArgument, message);
    };
    if (points == 0) refuse("the cloud has no points: expected at least 1");
    if (!options.target_size && !options.max_cluster_size && !options.max_variation) {
        refuse("incremental: expected a target size, max_cluster_size or max_variation");
    }
    if (options.target_size && options.max_cluster_size) {
        refuse("incremental: a target size stands instead of max_cluster_size; remove one");
    }
    if (options.target_size && *options.target_size == 0) {
        refuse("target_size 0: expected 1.." + std::to_string(points));
    }
    if (options.max_cluster_size && *options.max_cluster_size == 0) {
        refuse("max_cluster_size 0: expected at least 1");
    }
    if (options.max_variation &&
        !(*options.max_variation > 0 && *options.max_variation <= 1.0 / 3.0)) {
        std::ostringstream message;
        message << "max_variation " << *options.max_variation << ": expected above 0, at most 1/3";
        refuse(message.str());
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

Grown grow(std::span<const Vec3f> points, const RegionBounds& bounds, std::uint64_t seed,
           const RunContext& context) {
    Grown grown{grow_regions(points, bounds, seed, context), bounds, 0};
    const std::span<const Region> regions = grown.regions.regions;
    for_blocks_in_order(regions.size(), context, [&](std::size_t begin, std::size_t end) {
        grown.far_enough += static_cast<std::size_t>(std::ranges::count_if(
            regions.subspan(begin, end - begin),
            [&](const Region& region) { return reached(region, bounds) >= kStray; }));
    });
    return grown;
}

/// Looks for bounds that give about `target` clusters, where that many, and not many more, are no
/// strays.
Grown search(std::span<const Vec3f> points, std::uint64_t target, RegionBounds bounds,
             std::uint64_t seed, const RunContext& context) {
    constexpr int kMostRuns = 6;
    constexpr double kFewest = 0.8, kMost = 1.25;  // regions far enough, of the target
    constexpr double kLargest = 4;                 // n_max over the mean size
    const double mean_size = static_cast<double>(points.size()) / static_cast<double>(target);
    const auto rounded = [](double s) { return std::max<std::uint64_t>(2, std::llround(s)); };
    double size = mean_size, from = 0;
    for (int run = 1;; ++run) {
        bounds.max_size = rounded(size);
        const double to = run == kMostRuns ? 1.0 : 0.5 * (1.0 + from);
        Grown grown = grow(points, bounds, seed, context.part(from, to));
        from = to;
        const double share = static_cast<double>(grown.far_enough) / static_cast<double>(target);
        const bool enough = grown.regions.regions.size() >= target;
        if (run == kMostRuns || (enough && share >= kFewest && share <= kMost)) return grown;
        if (size >= kLargest * mean_size && share > 1) {
            bounds.max_variation *= share * share;
            continue;
        }
        size = std::clamp(size * share, 1.0, kLargest * mean_size);
        if (rounded(size) == bounds.max_size) return grown;
    }
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
    std::vector<Index> chosen(count);
    std::ranges::transform(std::span(ranked).first(count), chosen.begin(), &Ranked::region);
    std::ranges::sort(chosen, until_stopped(context, std::less<>()));
    return chosen;
}

}  // namespace

Clusters incremental_clusters(std::span<const Vec3f> points,
                              const IncrementalClusteringOptions& options,
                              const RunContext& context) {
    check(options, points.size());
    RegionBounds bounds;
    bounds.max_size = options.max_cluster_size.value_or(points.size());
    if (options.max_variation) bounds.max_variation = *options.max_variation;
    const RunContext growing = context.part(0.0, 0.8);
    const Grown grown =
        options.target_size
            ? search(points, std::min<std::uint64_t>(*options.target_size, points.size()), bounds,
                     options.seed, growing)
            : grow(points, bounds, options.seed, growing);
    const std::size_t count = options.target_size ? *options.target_size : grown.far_enough;
    return with_strays_joined(points, grown.regions, chosen_regions(grown, count, context),
                              context.part(0.8, 1.0));
}

PointCloud incremental_clustering(const PointCloud& cloud,
                                  const IncrementalClusteringOptions& options,
                                  const RunContext& context) {
    check(options, cloud.size());
    if (options.target_size && *options.target_size >= cloud.size()) return copy_of(cloud, context);
    const std::vector<Reduction> reductions =
        reductions_for(cloud, options.reductions, options.representative);
    Clusters clusters = incremental_clusters(cloud.positions, options, context.part(0.0, 0.8));
    if (options.target_size)
        split_clusters(cloud.positions, *options.target_size, clusters, context);
    context.checkpoint(0.85);
    PointCloud result = representatives(cloud, {clusters.members.data(), clusters.offsets},
                                        options.representative, reductions, context);
    context.checkpoint(1.0);
    return result;
}

}  // namespace stipple
