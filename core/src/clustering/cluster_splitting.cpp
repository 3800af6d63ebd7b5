#include "clustering/cluster_splitting.hpp"

#include "clustering/cluster_tree.hpp"

namespace stipple {

void split_clusters(std::span<const Vec3f> points, std::uint64_t target, Clusters& clusters,
                    const RunContext& context) {
    if (clusters.size() >= target) return;
    const RunContext quietly = context.quietly();
    ClusterTree tree(points, clusters);
    clusters.offsets = tree.cut(target, quietly).offsets;
    clusters.members.assign(tree.members().begin(), tree.members().end());
}

}  // namespace stipple
