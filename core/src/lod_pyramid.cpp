#include "stipple/lod_pyramid.hpp"

#include "cloud_copy.hpp"
#include "cluster_tree.hpp"
#include "first_touch.hpp"
#include "gather.hpp"
#include "incremental_levels.hpp"
#include "iterative_levels.hpp"
#include "multiphase_runs.hpp"
#include "nested_order.hpp"
#include "parallel_for.hpp"
#include "refuse.hpp"
#include "representatives.hpp"
#include "snapshots.hpp"
#include "stipple/neighbors.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <numeric>

namespace stipple {

namespace {

constexpr std::size_t kMaxLevels = 64;
constexpr std::size_t kBlock = 65'536;

/// Sizes that the coarsest level may have where it is to fit, smallest first.
std::vector<std::uint64_t> sizes_to_try(std::uint64_t points, const LodPyramidOptions& options) {
    constexpr double kSmaller = 0.9;
    std::vector<std::uint64_t> tries;
    for (std::uint64_t size = std::min(points, options.base_points); size > 0;
         size = static_cast<std::uint64_t>(kSmaller * static_cast<double>(size)))
        tries.push_back(size);
    std::ranges::reverse(tries);
    return tries;
}

/// Begins with the largest that fits, in place of the sizes that are hardly larger, and smaller
/// ones. Searches as if what is smaller than one that fits did so, too.
std::vector<std::uint64_t> with_fitting_base(std::span<const std::uint64_t> sizes,
                                             std::span<const std::uint64_t> tries,
                                             const LodPyramidOptions& options,
                                             const CloudOfSize& level_of,
                                             const RunContext& context) {
    const auto too_large = std::ranges::partition_point(
        tries, [&](std::uint64_t size) { return options.base_fits(level_of(size, context)); });
    if (too_large == tries.begin()) refuse("base_fits: expected to accept a level of one point");
    std::vector<std::uint64_t> fitting{*std::prev(too_large)};
    const double least = std::sqrt(options.ratio) * static_cast<double>(fitting[0]);
    for (const std::uint64_t size : sizes)
        if (static_cast<double>(size) > least) fitting.push_back(size);
    // Nothing is to be lost where the base is not much smaller than the whole.
    if (fitting.size() == 1 && fitting[0] < sizes.back()) fitting.push_back(sizes.back());
    return fitting;
}

/// The clusters of a cut in the order of their first members, which are less than `end`: by how
/// many first members are less, of which each has a bit.
std::vector<Index> by_first_member(std::span<const Index> members, std::span<const Index> offsets,
                                   std::size_t end, const RunContext& context) {
    constexpr std::size_t kBits = 64;
    std::vector<std::uint64_t> bits(end / kBits + 1);
    const std::span<const Index> clusters = offsets.first(offsets.size() - 1);
    for_blocks_in_order(clusters.size(), context, [&](std::size_t begin, std::size_t last) {
        for (const Index i : clusters.subspan(begin, last - begin))
            bits[members[i] / kBits] |= std::uint64_t{1} << members[i] % kBits;
    });
    std::vector<Index> less(bits.size());
    for (std::size_t word = 1; word < bits.size(); ++word)
        less[word] = less[word - 1] + static_cast<Index>(std::popcount(bits[word - 1]));
    auto order = made_in_blocks<std::vector<Index>>(clusters.size(), context);
    for_blocks_in_order(clusters.size(), context, [&](std::size_t begin, std::size_t last) {
        for (std::size_t i = begin; i < last; ++i) {
            const Index first = members[clusters[i]];
            const std::uint64_t below = (std::uint64_t{1} << first % kBits) - 1;
            const int in_word = std::popcount(bits[first / kBits] & below);
            order[less[first / kBits] + static_cast<Index>(in_word)] = static_cast<Index>(i);
        }
    });
    return order;
}

/// Coarsest first.
/// @param points, order  of the tree, and which of the cloud's points they are; none: as they
/// stand.
std::vector<LodLevel> cut_levels(const PointCloud& cloud, std::span<const Vec3f> points,
                                 std::span<const Index> order, ClusterTree& tree,
                                 std::span<const std::uint64_t> sizes,
                                 const LodPyramidOptions& options, const RunContext& context) {
    const Representative representative = options.simplification.hierarchical.representative;
    const std::vector<Reduction> reductions =
        reductions_for(cloud, options.simplification.reductions, representative);
    const std::vector<std::uint64_t> finest_first(sizes.rbegin(), sizes.rend());
    constexpr double kCut = 0.6, kGathered = 0.7;
    const std::vector<Cut> cuts = tree.cuts(finest_first, context.part(0, kCut));
    context.checkpoint(kCut);
    // Once for all levels.
    Samples samples(sizes.empty() ? 0 : cloud.size());
    parallel_for_blocks(samples.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        const MutableSampleSpan part = samples.all().part(begin, end);
        gather(points, tree.members().subspan(begin, end - begin), part);
        if (order.empty()) return;
        for (std::size_t i = 0; i < part.size; ++i) part.index[i] = order[part.index[i]];
    });
    const SampleSpan ordered = samples.all();
    std::vector<LodLevel> levels;
    for (auto cut = cuts.rbegin(); cut != cuts.rend(); ++cut) {
        context.checkpoint(std::lerp(
            kGathered, 1.0, static_cast<double>(levels.size()) / static_cast<double>(cuts.size())));
        LodLevel& level = levels.emplace_back();
        level.cloud = representatives(cloud, MemberLists{ordered.index, cut->offsets, ordered},
                                      representative, reductions, context);
        if (!order.empty())
            level.order = by_first_member(tree.members(), cut->offsets, cloud.size(), context);
    }
    return levels;
}

CloudOfSize cuts_of(const PointCloud& cloud, ClusterTree& tree, const SimplifyOptions& options) {
    return [&cloud, &tree, &options](std::uint64_t points, const RunContext& context) {
        if (points == cloud.size()) return copy_of(cloud, context);
        const Representative representative = options.hierarchical.representative;
        const std::vector<Index> offsets = tree.cut(points, context).offsets;
        return representatives(cloud, MemberLists{tree.members().data(), offsets}, representative,
                               reductions_for(cloud, options.reductions, representative), context);
    };
}

std::vector<Vec3f> in_order(std::span<const Vec3f> points, std::span<const Index> order,
                            const RunContext& context) {
    auto sorted = made_in_blocks<std::vector<Vec3f>>(order.size(), context);
    parallel_for_blocks(order.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        constexpr std::size_t kAhead = 16;  // that far the memory is asked for in advance
        for (std::size_t i = begin; i < end; ++i) {
            __builtin_prefetch(&points[order[std::min(i + kAhead, end - 1)]]);
            sorted[i] = points[order[i]];
        }
    });
    return sorted;
}

CloudOfSize prefixes_of(const PointCloud& cloud, const RunContext& context) {
    return [&cloud, order = nested_order(cloud.positions, context)](std::uint64_t points,
                                                                    const RunContext& run) {
        return subset(cloud, std::span(order).first(points), run);
    };
}

/// Levels made of each other.
/// @param sizes  ascending.
CloudOfSize levels_of_levels(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                             const SimplifyOptions& options, const RunContext& context) {
    std::vector<std::uint64_t> finest_first(sizes.rbegin(), sizes.rend());
    if (finest_first.front() == cloud.size()) finest_first.erase(finest_first.begin());
    std::map<std::uint64_t, PointCloud> levels;
    const auto keep = [&levels](PointCloud&& made) {
        const std::uint64_t points = made.size();
        levels[points] = std::move(made);
    };
    if (options.method == Method::Iterative) {
        IterativeSimplificationOptions iterative = options.iterative;
        iterative.reductions = options.reductions;
        iterative_levels(cloud, finest_first, iterative, keep, context);
    } else {
        IncrementalClusteringOptions incremental = options.incremental;
        incremental.reductions = options.reductions;
        incremental.seed = options.seed;
        incremental_levels(cloud, finest_first, incremental, keep, context);
    }
    return [&cloud, levels = std::move(levels)](std::uint64_t points, const RunContext& run) {
        return copy_of(points == cloud.size() ? cloud : levels.at(points), run);
    };
}

CloudOfSize multiphase_runs_of(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                               const SimplifyOptions& options, const RunContext& context) {
    MultiphaseOptions multiphase = {options.oversampling, options.iterative};
    multiphase.contraction.reductions = options.reductions;
    const auto runs = std::make_shared<MultiphaseRuns>(cloud, sizes, multiphase, context);
    return [runs](std::uint64_t points, const RunContext& run) { return runs->run(points, run); };
}

/// Each made when it is asked for, but the whole cloud.
CloudOfSize own_runs_of(const PointCloud& cloud, const SimplifyOptions& options,
                        const RunContext& context) {
    return [&cloud, run = runs_of(cloud, options, context)](std::uint64_t points,
                                                            const RunContext& level) {
        return points == cloud.size() ? copy_of(cloud, level) : run(points, level);
    };
}

}  // namespace

void validate(const LodPyramidOptions& options) {
    SimplifyOptions method = options.simplification;
    if (method.points || method.ratio || method.max_error || method.max_error_rel)
        refuse("target: a pyramid has none; give levels, or ratio and base_points");
    const auto refuse_bound = [](bool is_there, const std::string& name) {
        if (is_there) refuse(name, ": levels have counts instead; remove it");
    };
    switch (method.method) {
        case Method::Hierarchical:
            refuse_bound(method.hierarchical.max_cluster_size.has_value(), "max_cluster_size");
            refuse_bound(method.hierarchical.max_variation.has_value(), "max_variation");
            break;
        case Method::Incremental:
            refuse_bound(method.incremental.max_cluster_size.has_value(), "max_cluster_size");
            break;
        case Method::Voxel:
            refuse_bound(method.voxel.voxel_size.has_value(), "voxel_size");
            break;
        default:
            break;
    }
    method.points = 1;
    validate(method);
    if (options.nested) {
        if (method.method != Method::Iterative) {
            refuse("method ", to_string(method.method), ": expected iterative for nested levels");
        }
        if (!method.reductions.empty()) {
            refuse("reductions: ", method.reductions.begin()->first,
                   ": points of nested levels keep their attributes");
        }
        if (method.iterative != IterativeSimplificationOptions{}) {
            refuse(
                "nested levels: their order follows the shape alone: expected no k, placement, "
                "max_displacement, color_weight or attribute_weights");
        }
    }
    for (std::size_t i = 0; i < options.sizes.size(); ++i) {
        if (options.sizes[i] == 0) refuse("levels: 0 points: expected at least 1");
        if (i > 0 && options.sizes[i] <= options.sizes[i - 1]) {
            refuse("levels: ", options.sizes[i], " after ", options.sizes[i - 1],
                   ": expected each to be larger than the one before");
        }
    }
    if (options.sizes.size() > kMaxLevels) {
        refuse("levels: ", options.sizes.size(), " counts: expected at most 64");
    }
    require(options.ratio > 1 && options.ratio <= 64, "ratio", options.ratio,
            "above 1, at most 64");
    if (options.base_points == 0) refuse("base_points 0: expected at least 1");
}

std::vector<std::uint64_t> lod_sizes(std::uint64_t points, const LodPyramidOptions& options) {
    validate(options);
    std::vector<std::uint64_t> sizes;
    if (options.sizes.empty()) {
        sizes.push_back(points);
        while (sizes.back() > options.base_points) {
            const double next = std::round(static_cast<double>(sizes.back()) / options.ratio);
            // Rounding must not keep a ratio near 1 from ever getting there.
            sizes.push_back(std::max<std::uint64_t>(
                1, std::min(static_cast<std::uint64_t>(next), sizes.back() - 1)));
            if (sizes.size() > kMaxLevels) {
                refuse("ratio ", options.ratio, ": makes more than ", kMaxLevels, " levels from ",
                       points, " points down to ", options.base_points,
                       ": expected a larger ratio or base_points");
            }
        }
        std::ranges::reverse(sizes);
    } else {
        for (const std::uint64_t size : options.sizes) sizes.push_back(std::min(size, points));
        sizes.erase(std::ranges::unique(sizes).begin(), sizes.end());
    }
    return sizes;
}

namespace {

/// @param whole  gives the cloud, after which it is not looked at.
void build(const PointCloud& cloud, const std::function<PointCloud()>& whole,
           const LodPyramidOptions& options, const std::function<void(LodLevel&&)>& on_level,
           const RunContext& context) {
    validate(cloud);
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    std::vector<std::uint64_t> sizes = lod_sizes(cloud.size(), options);
    const bool fits = options.base_fits && options.sizes.empty();
    const std::vector<std::uint64_t> tries =
        fits ? sizes_to_try(cloud.size(), options) : std::vector<std::uint64_t>{};
    if (!options.order.empty() && options.order.size() != cloud.size()) {
        refuse("order of ", options.order.size(), " points: expected all ", cloud.size());
    }
    const SimplifyOptions& method = options.simplification;
    const bool cuts = method.method == Method::Hierarchical;
    const bool of_each_other =
        method.method == Method::Iterative || method.method == Method::Incremental;
    const bool at_once = options.nested || cuts || of_each_other;
    const bool runs_of_one_tree = method.method == Method::Multiphase;
    // Where levels are made one after the other, the coarsest is there before the finest is begun.
    const double prepared = runs_of_one_tree ? 0.3 : !at_once ? 0.1 : options.spacing ? 0.7 : 0.95;
    context.checkpoint(0.0);

    std::vector<Vec3f> sorted;
    std::span<const Vec3f> points(cloud.positions);
    // The base is tried by clusters of the cloud's own points, and so it is cut.
    const std::span<const Index> order = cuts && !fits ? options.order : std::span<const Index>();
    std::unique_ptr<ClusterTree> tree;
    CloudOfSize level_of;
    const RunContext preparing = context.part(0, prepared);
    std::vector<std::uint64_t> any_of;  // these sizes may be asked for
    std::ranges::set_union(sizes, tries, std::back_inserter(any_of));
    if (options.nested) {
        level_of = prefixes_of(cloud, preparing);
    } else if (cuts) {
        if (!order.empty()) points = sorted = in_order(points, order, context);
        tree = std::make_unique<ClusterTree>(points);
        level_of = cuts_of(cloud, *tree, method);
    } else if (runs_of_one_tree) {
        level_of = multiphase_runs_of(cloud, any_of, method, preparing);
    } else if (of_each_other) {
        level_of = levels_of_levels(cloud, any_of, method, preparing);
    } else {
        level_of = own_runs_of(cloud, method, preparing);
    }
    const RunContext quietly{.stop = context.stop, .progress = {}, .threads = context.threads};
    if (fits) sizes = with_fitting_base(sizes, tries, options, level_of, quietly);

    unsigned level = 0;
    const double all =
        static_cast<double>(std::accumulate(sizes.begin(), sizes.end(), std::uint64_t{0}));
    double emitted = 0;
    const auto progress = [&](double points_done) {
        return std::lerp(prepared, 1.0, points_done / all);
    };
    const auto emit = [&](LodLevel&& next) {
        if (options.spacing) next.spacing = mean_spacing(next.cloud.positions, quietly);
        emitted += static_cast<double>(next.cloud.size());
        next.level = level++;
        on_level(std::move(next));
        context.checkpoint(progress(emitted));
    };
    std::span<const std::uint64_t> made(sizes);  // all but the whole cloud, which is there
    if (made.back() == cloud.size() && !options.nested) made = made.first(made.size() - 1);
    if (!cuts) {
        for (const std::uint64_t size : made) {
            const double to = progress(emitted + static_cast<double>(size));
            emit({.cloud = level_of(size, context.part(progress(emitted), to))});
        }
        level_of = {};
        if (made.size() < sizes.size()) emit({.cloud = whole()});
        return;
    }
    std::vector<LodLevel> levels =
        cut_levels(cloud, points, order, *tree, made, options, preparing);
    tree.reset();  // not needed while levels are encoded
    std::vector<Vec3f>().swap(sorted);
    for (LodLevel& next : levels) emit(std::move(next));
    if (made.size() < sizes.size()) emit({.cloud = whole()});
}

}  // namespace

void build_lod_pyramid(const PointCloud& cloud, const LodPyramidOptions& options,
                       const std::function<void(LodLevel&&)>& on_level, const RunContext& context) {
    build(
        cloud, [&] { return copy_of(cloud, context); }, options, on_level, context);
}

void build_lod_pyramid(PointCloud&& cloud, const LodPyramidOptions& options,
                       const std::function<void(LodLevel&&)>& on_level, const RunContext& context) {
    build(
        cloud, [&] { return std::move(cloud); }, options, on_level, context);
}

}  // namespace stipple
