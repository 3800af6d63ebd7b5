#include "stipple/lod_pyramid.hpp"

#include "base/refuse.hpp"
#include "cloud/cloud_copy.hpp"
#include "clustering/base_clusters.hpp"
#include "clustering/cluster_tree.hpp"
#include "clustering/incremental_levels.hpp"
#include "clustering/representatives.hpp"
#include "contraction/iterative_levels.hpp"
#include "contraction/multiphase_runs.hpp"
#include "contraction/nested_order.hpp"
#include "simplify/snapshots.hpp"
#include "stipple/neighbors.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <numeric>

namespace stipple {

namespace {

constexpr std::size_t kMaxLevels = 64;

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

/// Coarsest first.
/// @param tree  of the base.
std::vector<LodLevel> cut_levels(const PointCloud& cloud, const LevelBase& base, ClusterTree& tree,
                                 std::span<const std::uint64_t> sizes,
                                 const LodPyramidOptions& options, const RunContext& context) {
    if (sizes.empty()) return {};
    const Representative representative = options.simplification.hierarchical.representative;
    const Reductions reductions =
        reductions_for(cloud, options.simplification.reductions, representative);
    const std::vector<std::uint64_t> finest_first(sizes.rbegin(), sizes.rend());
    constexpr double kCut = 0.6, kGathered = 0.7;
    const std::vector<Cut> cuts = tree.cuts(finest_first, context.part(0, kCut));
    context.checkpoint(kCut);
    tree.forget_nodes();
    const BaseClusters clusters(base, tree.members(), context);
    std::vector<LodLevel> levels;
    for (auto cut = cuts.rbegin(); cut != cuts.rend(); ++cut) {
        context.checkpoint(std::lerp(
            kGathered, 1.0, static_cast<double>(levels.size()) / static_cast<double>(cuts.size())));
        levels.push_back(clusters.level(cloud, cut->offsets, representative, reductions, context));
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

CloudOfSize prefixes_of(const PointCloud& cloud, const RunContext& context) {
    return [&cloud, order = nested_order(cloud.positions, context)](std::uint64_t points,
                                                                    const RunContext& run) {
        return subset(cloud, std::span(order).first(points), run);
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

/// Of which levels and how many points, ascending.
struct Sizes {
    std::vector<std::uint64_t> levels;
    std::vector<std::uint64_t> tries;  ///< of a coarsest level that is to fit; else none

    /// Those that may be asked for.
    std::vector<std::uint64_t> all() const {
        std::vector<std::uint64_t> all;
        std::ranges::set_union(levels, tries, std::back_inserter(all));
        return all;
    }
};

/// Hands levels on, the coarsest first, and reports how far that is.
class LevelEmitter {
public:
    /// @param prepared  part of the work that is done before the first.
    LevelEmitter(std::span<const std::uint64_t> sizes, double prepared,
                 const LodPyramidOptions& options, const std::function<void(LodLevel&&)>& on_level,
                 const RunContext& context)
        : points_(std::accumulate(sizes.begin(), sizes.end(), std::uint64_t{0})),
          prepared_(prepared),
          options_(options),
          on_level_(on_level),
          context_(context) {}

    void emit(LodLevel&& next) {
        if (options_.spacing) next.spacing = mean_spacing(next.cloud.positions, context_.quietly());
        emitted_ += next.cloud.size();
        next.level = level_++;
        on_level_(std::move(next));
        context_.checkpoint(progress(emitted_));
    }
    /// For making the next, of so many points.
    RunContext part_of_next(std::uint64_t size) const {
        return context_.part(progress(emitted_), progress(emitted_ + size));
    }

private:
    double progress(std::uint64_t emitted) const {
        return std::lerp(prepared_, 1.0,
                         static_cast<double>(emitted) / static_cast<double>(points_));
    }

    std::uint64_t points_;  ///< of all levels
    double prepared_;
    const LodPyramidOptions& options_;
    const std::function<void(LodLevel&&)>& on_level_;
    const RunContext& context_;
    unsigned level_ = 0;
    std::uint64_t emitted_ = 0;  ///< points
};

/// All but the whole cloud, which is there.
std::span<const std::uint64_t> made_of(const std::vector<std::uint64_t>& sizes,
                                       const PointCloud& cloud) {
    const std::span<const std::uint64_t> all(sizes);
    return all.back() == cloud.size() ? all.first(all.size() - 1) : all;
}

/// All but the whole cloud, coarsest first: cuts of one tree.
/// @param sizes  made to fit.
std::vector<LodLevel> levels_of_tree(const PointCloud& cloud, Sizes& sizes,
                                     const LodPyramidOptions& options, const RunContext& context) {
    // The base is tried by clusters of the cloud's own points, and so it is cut.
    const std::span<const Index> order =
        sizes.tries.empty() ? options.order : std::span<const Index>();
    const LevelBase base(cloud, order, context);
    ClusterTree tree(base.points());
    if (!sizes.tries.empty())
        sizes.levels =
            with_fitting_base(sizes.levels, sizes.tries, options,
                              cuts_of(cloud, tree, options.simplification), context.quietly());
    std::vector<LodLevel> levels =
        cut_levels(cloud, base, tree, made_of(sizes.levels, cloud), options, context);
    if (order.empty())
        for (LodLevel& level : levels) level.order.clear();
    return levels;
}

/// The same of levels that are made of each other.
std::vector<LodLevel> levels_of_levels(const PointCloud& cloud, Sizes& sizes,
                                       const LodPyramidOptions& options,
                                       const RunContext& context) {
    const std::vector<std::uint64_t> all = sizes.all();
    const std::span<const std::uint64_t> made = made_of(all, cloud);
    const std::vector<std::uint64_t> finest_first(made.rbegin(), made.rend());
    std::map<std::uint64_t, LodLevel> by_size;
    const auto keep = [&by_size](LodLevel&& level) {
        const std::uint64_t points = level.cloud.size();
        by_size[points] = std::move(level);
    };
    const SimplifyOptions& method = options.simplification;
    if (method.method == Method::Iterative) {
        IterativeSimplificationOptions iterative = method.iterative;
        iterative.reductions = method.reductions;
        iterative_levels(
            cloud, finest_first, iterative,
            [&](PointCloud&& level) { keep({.cloud = std::move(level)}); }, context);
    } else {
        IncrementalClusteringOptions incremental = method.incremental;
        incremental.reductions = method.reductions;
        incremental.seed = method.seed;
        incremental_levels(cloud, options.order, finest_first, incremental, keep, context);
    }
    const auto level_of = [&](std::uint64_t points, const RunContext& run) {
        return copy_of(points == cloud.size() ? cloud : by_size.at(points).cloud, run);
    };
    if (!sizes.tries.empty())
        sizes.levels =
            with_fitting_base(sizes.levels, sizes.tries, options, level_of, context.quietly());
    std::vector<LodLevel> levels;
    for (const std::uint64_t size : made_of(sizes.levels, cloud))
        levels.push_back(std::move(by_size.at(size)));
    return levels;
}

/// All levels are there before the first is handed on.
/// @param whole  gives the cloud, after which it is not looked at.
void build_at_once(const PointCloud& cloud, const std::function<PointCloud()>& whole, Sizes sizes,
                   const LodPyramidOptions& options,
                   const std::function<void(LodLevel&&)>& on_level, const RunContext& context) {
    const double prepared = options.spacing ? 0.7 : 0.95;
    const bool is_tree = options.simplification.method == Method::Hierarchical;
    std::vector<LodLevel> levels = (is_tree ? levels_of_tree : levels_of_levels)(
        cloud, sizes, options, context.part(0, prepared));
    LevelEmitter emitter(sizes.levels, prepared, options, on_level, context);
    for (LodLevel& next : levels) emitter.emit(std::move(next));
    if (levels.size() < sizes.levels.size()) emitter.emit({.cloud = whole()});
}

/// How the levels of other methods are made, one after the other.
struct LevelsInTurn {
    CloudOfSize level_of;
    double prepared;  ///< part of the work that was done before the first
};

LevelsInTurn levels_in_turn(const PointCloud& cloud, const Sizes& sizes,
                            const LodPyramidOptions& options, const RunContext& context) {
    const SimplifyOptions& method = options.simplification;
    constexpr double kOfOneTree = 0.3, kOfTheirOwn = 0.1;
    const double at_once = options.spacing ? 0.7 : 0.95;
    if (options.nested) return {prefixes_of(cloud, context.part(0, at_once)), at_once};
    switch (method.method) {
        case Method::Multiphase:
            return {multiphase_runs_of(cloud, sizes.all(), method, context.part(0, kOfOneTree)),
                    kOfOneTree};
        default:
            // The coarsest is there before the finest is begun.
            return {own_runs_of(cloud, method, context.part(0, kOfTheirOwn)), kOfTheirOwn};
    }
}

/// @param whole  gives the cloud, after which it is not looked at.
void build_in_turn(const PointCloud& cloud, const std::function<PointCloud()>& whole, Sizes sizes,
                   const LodPyramidOptions& options,
                   const std::function<void(LodLevel&&)>& on_level, const RunContext& context) {
    LevelsInTurn in_turn = levels_in_turn(cloud, sizes, options, context);
    if (!sizes.tries.empty())
        sizes.levels = with_fitting_base(sizes.levels, sizes.tries, options, in_turn.level_of,
                                         context.quietly());
    LevelEmitter emitter(sizes.levels, in_turn.prepared, options, on_level, context);
    const std::span<const std::uint64_t> made = options.nested
                                                    ? std::span<const std::uint64_t>(sizes.levels)
                                                    : made_of(sizes.levels, cloud);
    for (const std::uint64_t size : made)
        emitter.emit({.cloud = in_turn.level_of(size, emitter.part_of_next(size))});
    in_turn.level_of = {};
    if (made.size() < sizes.levels.size()) emitter.emit({.cloud = whole()});
}

/// Colours of levels are the means of the points that they stand for, also where a level keeps
/// points: those of single points speckle where the cloud is seen from afar.
LodPyramidOptions with_mean_colors(LodPyramidOptions options, const PointCloud& cloud) {
    SimplifyOptions& method = options.simplification;
    const bool copies = method.method == Method::Hierarchical ||
                        method.method == Method::Incremental || method.method == Method::Voxel;
    if (copies && !cloud.colors.empty() && find_attribute(cloud, "color") == nullptr)
        method.reductions.emplace("color", Reduction::Mean);
    return options;
}

void build(const PointCloud& cloud, const std::function<PointCloud()>& whole,
           const LodPyramidOptions& given, const std::function<void(LodLevel&&)>& on_level,
           const RunContext& context) {
    require_cleaned(cloud);
    const LodPyramidOptions options = with_mean_colors(given, cloud);
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    Sizes sizes{.levels = lod_sizes(cloud.size(), options), .tries = {}};
    if (options.base_fits && options.sizes.empty())
        sizes.tries = sizes_to_try(cloud.size(), options);
    if (!options.order.empty() && options.order.size() != cloud.size()) {
        refuse("order of ", options.order.size(), " points: expected all ", cloud.size());
    }
    context.checkpoint(0.0);
    const Method method = options.simplification.method;
    const bool at_once =
        !options.nested && (method == Method::Hierarchical || method == Method::Iterative ||
                            method == Method::Incremental);
    (at_once ? build_at_once : build_in_turn)(cloud, whole, std::move(sizes), options, on_level,
                                              context);
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
