#include "clustering/incremental_levels.hpp"

#include "cloud/cloud_copy.hpp"
#include "clustering/base_clusters.hpp"
#include "clustering/cluster_tree.hpp"
#include "clustering/representatives.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

namespace stipple {

namespace {

constexpr std::uint64_t kMostOfTree = 128;  // points of a cluster that is cut from the tree

/// How the levels are made, each finest first.
struct Plan {
    struct Grown {
        std::uint64_t size;
        std::uint64_t base;  ///< points of the cloud or of a level before, over which it is grown
    };
    std::span<const std::uint64_t> cuts;  ///< sizes; of one tree of the cloud
    std::vector<Grown> grown;
};

Plan plan_for(std::span<const std::uint64_t> sizes, std::uint64_t points,
              const IncrementalClusteringOptions& options) {
    Plan plan;
    auto first_grown = sizes.begin();
    if (are_split(sizes.front(), points, options)) {
        first_grown = std::ranges::find_if(
            sizes, [&](std::uint64_t size) { return points / size >= kMostOfTree; });
    }
    plan.cuts = {sizes.begin(), first_grown};
    auto too_few = sizes.begin();  // the first level of too few points to be a base
    for (const std::uint64_t size : std::span(first_grown, sizes.end())) {
        while (!options.max_variation && *too_few / size >= kPointsToGrow) ++too_few;
        plan.grown.push_back({size, too_few == sizes.begin() ? points : *(too_few - 1)});
    }
    return plan;
}

class LevelMaker {
public:
    LevelMaker(const PointCloud& cloud, std::span<const Index> order, const Plan& plan,
               const IncrementalClusteringOptions& options,
               const std::function<void(LodLevel&&)>& on_level, const RunContext& context)
        : cloud_(cloud),
          has_curve_(!order.empty()),
          plan_(plan),
          options_(options),
          reductions_(reductions_for(cloud, options.reductions, options.representative)),
          on_level_(on_level) {
        bases_.emplace(cloud.size(), LevelBase(cloud, order, context));
    }

    void cut(const RunContext& context) {
        const LevelBase& base = bases_.begin()->second;
        ClusterTree tree(base.points(), width_of_cluster);
        constexpr double kCut = 0.7;
        const std::vector<Cut> cuts = tree.cuts(plan_.cuts, context.part(0, kCut));
        context.checkpoint(kCut);
        tree.forget_nodes();
        const BaseClusters clusters(base, tree.members(), context);
        for (const Cut& cut : cuts) emit(clusters, cut.offsets, context);
        context.checkpoint(1);
    }

    void grow(const Plan::Grown& level, const RunContext& context) {
        bases_.erase(bases_.upper_bound(level.base), bases_.end());  // bases of those before
        const LevelBase& base = bases_.at(level.base);
        IncrementalClusteringOptions one = options_;
        one.target_size = level.size;
        const Clusters clusters = incremental_clusters(base.points(), one, context);
        emit(BaseClusters(base, clusters.members, context), clusters.offsets, context);
    }

private:
    void emit(const BaseClusters& clusters, std::span<const Index> offsets,
              const RunContext& context) {
        LodLevel level =
            clusters.level(cloud_, offsets, options_.representative, reductions_, context);
        const std::uint64_t size = level.cloud.size();
        const bool is_base =
            std::ranges::any_of(plan_.grown, [&](const auto& g) { return g.base == size; });
        if (is_base) bases_.emplace(size, clusters.base_of(level, offsets, context));
        if (!has_curve_) level.order.clear();
        on_level_(std::move(level));
    }

    const PointCloud& cloud_;
    bool has_curve_;
    const Plan& plan_;
    const IncrementalClusteringOptions& options_;
    Reductions reductions_;
    const std::function<void(LodLevel&&)>& on_level_;
    std::map<std::uint64_t, LevelBase> bases_;  ///< by their points; those that are still needed
};

}  // namespace

void incremental_levels(const PointCloud& cloud, std::span<const Index> order,
                        std::span<const std::uint64_t> sizes,
                        const IncrementalClusteringOptions& options,
                        const std::function<void(LodLevel&&)>& on_level,
                        const RunContext& context) {
    constexpr double kCut = 0.6, kGrown = 0.7;  // of what is left to do
    for (; !sizes.empty() && sizes.front() == cloud.size(); sizes = sizes.subspan(1))
        on_level({.cloud = copy_of(cloud, context)});
    if (sizes.empty()) return;
    const Plan plan = plan_for(sizes, cloud.size(), options);
    LevelMaker maker(cloud, order, plan, options, on_level, context);
    double done = 0;
    if (!plan.cuts.empty()) {
        done = plan.grown.empty() ? 1 : kCut;
        maker.cut(context.part(0, done));
    }
    for (const Plan::Grown& level : plan.grown) {
        const bool is_last = &level == &plan.grown.back();
        const double before = std::exchange(done, is_last ? 1 : std::lerp(done, 1.0, kGrown));
        maker.grow(level, context.part(before, done));
    }
    context.checkpoint(1.0);
}

}  // namespace stipple
