#include "simplify/snapshots.hpp"

#include "clustering/cluster_tree.hpp"
#include "clustering/representatives.hpp"
#include "particles/particle_simulator.hpp"
#include "stipple/iterative_simplification.hpp"

#include <memory>
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
    const Reductions reductions = reductions_for(cloud, options.reductions, kind);
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
    constexpr double kPrepared = 0.1;
    const CloudOfSize run = runs_of(cloud, options, context.part(0.0, kPrepared));
    const auto all =
        static_cast<double>(std::accumulate(sizes.begin(), sizes.end(), std::uint64_t{0}));
    double done = kPrepared;  // the time that a run takes grows with its points
    for (const std::uint64_t size : sizes) {
        const double share = static_cast<double>(size) / all;
        const double before = std::exchange(done, done + (1.0 - kPrepared) * share);
        on_cloud(run(size, context.part(before, done)));
    }
}

CloudOfSize runs_of(const PointCloud& cloud, const SimplifyOptions& options,
                    const RunContext& context) {
    if (options.method == Method::Particles) {
        ParticleSimulationOptions particles = options.particles;
        particles.reductions = options.reductions;
        particles.seed = options.seed;
        const auto simulator = std::make_shared<ParticleSimulator>(cloud, particles, context);
        return [simulator](std::uint64_t size, const RunContext& run) {
            return simulator->run(size, run);
        };
    }
    SimplifyOptions one = options;
    one.ratio = one.max_error_rel = one.max_error = std::nullopt;
    return [&cloud, one](std::uint64_t size, const RunContext& run) mutable {
        one.points = size;
        return simplify(cloud, one, run);
    };
}

}  // namespace stipple
