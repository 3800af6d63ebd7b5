#include "snapshots.hpp"

#include "cluster_tree.hpp"
#include "representatives.hpp"
#include "stipple/error_bounded.hpp"
#include "stipple/iterative_simplification.hpp"

#include <numeric>
#include <utility>
#include <vector>

namespace stipple {

namespace {

/// Every cut of one tree.
void make_cuts(const PointCloud& cloud, const SimplifyOptions& options,
               std::span<const std::uint64_t> sizes,
               const std::function<void(PointCloud&&)>& on_cloud, const RunContext& context) {
    const Representative kind = options.hierarchical.representative;
    const std::vector<Reduction> reductions = reductions_for(cloud, options.reductions, kind);
    ClusterTree tree(cloud.positions);
    for (const std::uint64_t size : sizes) {
        const std::vector<Index> offsets = tree.cut(size, context).offsets;
        on_cloud(representatives(cloud, MemberLists{tree.members().data(), offsets}, kind,
                                 reductions, context));
    }
}

}  // namespace

void make_snapshots(const PointCloud& cloud, const SimplifyOptions& options,
                    std::span<const std::uint64_t> sizes,
                    const std::function<void(PointCloud&&)>& on_cloud, const RunContext& context) {
    require_error_bounded(options.method);
    if (sizes.empty()) return;
    IterativeSimplificationOptions contraction = options.iterative;
    contraction.reductions = options.reductions;
    switch (options.method) {
        case Method::Hierarchical:
            return make_cuts(cloud, options, sizes, on_cloud, context);
        case Method::Iterative:
            return iterative_snapshots(cloud, sizes, contraction, on_cloud, context);
        case Method::Multiphase:
            return multiphase_snapshots(cloud, sizes, {options.oversampling, contraction}, on_cloud,
                                        context);
        default:
            break;
    }
    SimplifyOptions one = options;
    one.ratio = one.max_error_rel = one.max_error = std::nullopt;
    const auto all =
        static_cast<double>(std::accumulate(sizes.begin(), sizes.end(), std::uint64_t{0}));
    double done = 0;  // the time that a simulation takes grows with its points
    for (const std::uint64_t size : sizes) {
        one.points = size;
        const double before = std::exchange(done, done + static_cast<double>(size) / all);
        on_cloud(simplify(cloud, one, context.part(before, done)));
    }
}

}  // namespace stipple
