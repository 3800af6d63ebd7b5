#include "stipple/hierarchical_clustering.hpp"

#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "cloud/cloud_copy.hpp"
#include "clustering/cluster_tree.hpp"
#include "clustering/clustering_options.hpp"
#include "clustering/representatives.hpp"

namespace stipple {

namespace {

void check(const HierarchicalClusteringOptions& options, std::size_t points) {
    if (points == 0) refuse("the cloud has no points: expected at least 1");
    const bool bounded = options.max_cluster_size || options.max_variation;
    if (!options.target_size && !bounded) {
        refuse("hierarchical: expected a target size, max_cluster_size or max_variation");
    }
    if (options.target_size && bounded) {
        refuse(
            "hierarchical: a target size excludes max_cluster_size and max_variation; remove them");
    }
    if (options.target_size && *options.target_size == 0) {
        refuse("target_size 0: expected 1..", points);
    }
    check_ranges(options);
}

/// The clusters that the options ask for. A target is at most the number of points.
Cut grow_clusters(ClusterTree& tree, const HierarchicalClusteringOptions& options,
                  const RunContext& context) {
    if (options.target_size) return tree.cut(*options.target_size, context);
    SplitRule rule;
    if (options.max_cluster_size) rule.max_size = static_cast<double>(*options.max_cluster_size);
    if (options.max_variation) rule.max_variation = *options.max_variation;
    tree.grow(rule, context);
    return tree.leaves(context);
}

/// A target of all points, or more of them, leaves the cloud as it is.
bool keeps_everything(const HierarchicalClusteringOptions& options, std::size_t points) {
    return options.target_size && *options.target_size >= points;
}

}  // namespace

PointCloud hierarchical_clustering(const PointCloud& cloud,
                                   const HierarchicalClusteringOptions& options,
                                   const RunContext& context) {
    require_cleaned(cloud);
    check(options, cloud.size());
    const Reductions reductions = reductions_for(cloud, options.reductions, options.representative);
    if (keeps_everything(options, cloud.size())) return copy_of(cloud, context);
    context.checkpoint(0.0);
    PointCloud result;
    with_threads(context, [&] {
        ClusterTree tree(cloud.positions);
        const std::vector<Index> offsets =
            grow_clusters(tree, options, context.part(0, 0.8)).offsets;
        context.checkpoint(0.8);
        result = representatives(cloud, MemberLists{tree.members().data(), offsets},
                                 options.representative, reductions, context);
    });
    context.checkpoint(1.0);
    return result;
}

Clusters hierarchical_clusters(std::span<const Vec3f> points,
                               const HierarchicalClusteringOptions& options,
                               const RunContext& context) {
    check(options, points.size());
    HierarchicalClusteringOptions bounded = options;
    if (keeps_everything(options, points.size())) bounded.target_size = points.size();
    ClusterTree tree(points);
    Clusters clusters;
    clusters.offsets = grow_clusters(tree, bounded, context).offsets;
    clusters.members.assign(tree.members().begin(), tree.members().end());
    return clusters;
}

}  // namespace stipple
