#include "incremental_levels.hpp"

#include "base_clusters.hpp"
#include "cloud_copy.hpp"
#include "cluster_tree.hpp"
#include "representatives.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <utility>
#include <vector>

namespace stipple {

namespace {

constexpr std::uint64_t kMostOfTree = 128;   // points of a cluster that is cut from the tree
constexpr std::uint64_t kBetweenBases = 3;  // points of one for one of the next, at least

class LevelMaker {
public:
    /// @param smallest  size of a level.
    LevelMaker(const PointCloud& cloud, std::span<const Index> order, std::uint64_t smallest,
               const IncrementalClusteringOptions& options,
               const std::function<void(LodLevel&&)>& on_level, const RunContext& context)
        : cloud_(cloud),
          has_curve_(!order.empty()),
          smallest_(smallest),
          options_(options),
          reductions_(reductions_for(cloud, options.reductions, options.representative)),
          on_level_(on_level) {
        bases_.emplace_back(cloud, order, context);
    }

    void cut(std::span<const std::uint64_t> sizes, const RunContext& context) {
        const LevelBase& base = bases_.front();
        ClusterTree tree(base.points(), width_of_cluster);
        constexpr double kCut = 0.7;
        const std::vector<Cut> cuts = tree.cuts(sizes, context.part(0, kCut));
        context.checkpoint(kCut);
        tree.forget_nodes();
        const BaseClusters clusters(base, tree.members(), context);
        for (const Cut& cut : cuts) emit(clusters, cut.offsets, context);
        context.checkpoint(1);
    }

    void grow(std::uint64_t size, const RunContext& context) {
        while (bases_.size() > 1 && bases_[1].points().size() / size >= kPointsToGrow)
            bases_.pop_front();
        const LevelBase& base = bases_.front();
        IncrementalClusteringOptions one = options_;
        one.target_size = size;
        const Clusters clusters = incremental_clusters(base.points(), one, context);
        emit(BaseClusters(base, clusters.members, context), clusters.offsets, context);
    }

private:
    void emit(const BaseClusters& clusters, std::span<const Index> offsets,
              const RunContext& context) {
        LodLevel level =
            clusters.level(cloud_, offsets, options_.representative, reductions_, context);
        if (is_base(level.cloud.size()))
            bases_.push_back(clusters.base_of(level, offsets, context));
        if (!has_curve_) level.order.clear();
        on_level_(std::move(level));
    }

    /// Whether levels to come may be grown over a level.
    bool is_base(std::uint64_t size) const {
        return !options_.max_variation && size / smallest_ >= kPointsToGrow &&
               bases_.back().points().size() / size >= kBetweenBases;
    }

    const PointCloud& cloud_;
    bool has_curve_;
    std::uint64_t smallest_;
    const IncrementalClusteringOptions& options_;
    std::vector<Reduction> reductions_;
    const std::function<void(LodLevel&&)>& on_level_;
    /// Finest first, from the one that the next level is of. They must not move.
    std::deque<LevelBase> bases_;
};

/// Of sizes, how many are cuts of one tree of the cloud.
std::size_t cut_count(std::span<const std::uint64_t> sizes, std::uint64_t points,
                      const IncrementalClusteringOptions& options) {
    if (sizes.empty() || !are_split(sizes.front(), points, options)) return 0;
    const auto first_grown = std::ranges::find_if(
        sizes, [&](std::uint64_t size) { return points / size >= kMostOfTree; });
    return static_cast<std::size_t>(first_grown - sizes.begin());
}

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
    LevelMaker maker(cloud, order, sizes.back(), options, on_level, context);
    const std::size_t cuts = cut_count(sizes, cloud.size(), options);
    double done = 0;
    if (cuts > 0) {
        done = cuts < sizes.size() ? kCut : 1;
        maker.cut(sizes.first(cuts), context.part(0, done));
    }
    for (const std::uint64_t size : sizes.subspan(cuts)) {
        const bool is_last = size == sizes.back();
        const double before = std::exchange(done, is_last ? 1 : std::lerp(done, 1.0, kGrown));
        maker.grow(size, context.part(before, done));
    }
    context.checkpoint(1.0);
}

}  // namespace stipple
