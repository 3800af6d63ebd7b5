#include "stipple/particle_simulation.hpp"

#include "hilbert_order.hpp"
#include "parallel_for.hpp"
#include "particle_density.hpp"
#include "particle_relaxation.hpp"
#include "particle_surface.hpp"
#include "random.hpp"
#include "representatives.hpp"
#include "stipple/error.hpp"
#include "stipple/local_analysis.hpp"
#include "stipple/neighbors.hpp"
#include "symmetric_eigen.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <sstream>

namespace stipple {

namespace {

constexpr std::size_t kSamplesPerParticle = 16;
constexpr unsigned kNeighbors = 16;
constexpr std::size_t kBlock = 1'024;

// Radii over the spacing. With the first, each particle feels the ring around it and the whole
// comes to rest; it is evenly spread then, but for pairs that the others press together. With the
// second, only pairs that are too close feel each other, and part.
constexpr float kSpreadRadius = 1.25F;
constexpr float kPartRadius = 0.88F;
constexpr double kLargestOverlap = 0.05;

template <typename... Parts>
[[noreturn]] void refuse(const Parts&... parts) {
    std::ostringstream message;
    (message << ... << parts);
    throw Error(ErrorCode::InvalidArgument, message.str());
}

void check(const ParticleSimulationOptions& options, const PointCloud& cloud) {
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    constexpr auto kMost = std::numeric_limits<Index>::max();
    if (options.target_size == 0 || options.target_size > kMost)
        refuse("target_size ", options.target_size, ": expected 1..", kMost);
    if (!(options.adaptivity >= 0 && options.adaptivity <= 1))
        refuse("adaptivity ", options.adaptivity, ": expected 0..1");
    if (!(options.max_grading >= 1 && std::isfinite(options.max_grading)))
        refuse("max_grading ", options.max_grading, ": expected at least 1, finite");
    if (options.max_iterations == 0) refuse("max_iterations 0: expected at least 1");
    if (!(options.tolerance > 0 && options.tolerance < 1))
        refuse("tolerance ", options.tolerance, ": expected above 0, below 1");
    validate(options.regions, cloud);
}

/// The numbers of the points that stand for the surface, along a space-filling curve: all of them,
/// or, for a uniform simplification, as many as particles can tell apart.
std::vector<Index> choose_samples(const PointCloud& cloud, const ParticleSimulationOptions& options,
                                  const RunContext& context) {
    std::vector<Index> order = hilbert_order(cloud.positions, context);
    const std::size_t n = order.size();
    const bool uniform = options.adaptivity == 0 && options.regions.empty();
    const std::size_t count = uniform ? std::min<std::size_t>(n, kSamplesPerParticle * options.target_size) : n;
    if (count == n) return order;
    for (std::size_t i = 0; i < count; ++i) order[i] = order[(2 * i + 1) * n / (2 * count)];
    order.resize(count);
    return order;
}

struct Analysis {
    std::vector<Vec3f> normals;
    std::vector<float> radius, variation;
};

Analysis analyze(const std::vector<Vec3f>& samples, const RunContext& context) {
    const NeighborLists lists = k_nearest_neighbors(samples, kNeighbors, context);
    Analysis a{std::vector<Vec3f>(samples.size()), std::vector<float>(samples.size()),
               std::vector<float>(samples.size())};
    parallel_for_blocks(samples.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const auto near = lists.of(i);
            Vec3d mean = Vec3d::Zero();
            for (const Index j : near) mean += (samples[j] - samples[i]).cast<double>();
            mean /= static_cast<double>(std::max<std::size_t>(1, near.size()));
            Symmetric3 s;
            for (const Index j : near) {
                const Vec3d d = (samples[j] - samples[i]).cast<double>() - mean;
                s.xx += d.x() * d.x(); s.xy += d.x() * d.y(); s.xz += d.x() * d.z();
                s.yy += d.y() * d.y(); s.yz += d.y() * d.z(); s.zz += d.z() * d.z();
            }
            const auto l = eigenvalues(s);
            a.normals[i] = eigenvector(s, l[0]).cast<float>();
            a.variation[i] = s.trace() > 0 ? static_cast<float>(std::max(0.0, l[0]) / s.trace()) : 0;
            a.radius[i] = near.empty() ? 0 : std::sqrt(lists.distances_sq[lists.offsets[i + 1] - 1]);
        }
    });
    return a;
}

/// Lowers weights to a bound: what `most` particles weigh, of `particles` in all.
void bound_weights(std::vector<float>& weights, double particles, double most) {
    constexpr int kRounds = 4;  // each lowers the sum, and so the bound
    for (int round = 0; round < kRounds; ++round) {
        double sum = 0;
        for (const float w : weights) sum += static_cast<double>(w);
        const auto bound = static_cast<float>(most * sum / particles);
        for (float& w : weights) w = std::min(w, bound);
    }
}

/// Spreading (§3.3): `count` particles, so many at each sample as its weight says.
std::vector<Index> spread(const std::vector<float>& weights, std::size_t count,
                          std::uint64_t seed) {
    double sum = 0;
    for (const float w : weights) sum += static_cast<double>(w);
    const double phase = static_cast<double>(random_bits(seed, 0) >> 11U) * 0x1p-53;
    std::vector<Index> sample_of(count);
    double passed = 0;
    std::size_t sample = 0;
    for (std::size_t i = 0; i < count; ++i) {
        const double place = (static_cast<double>(i) + phase) / static_cast<double>(count) * sum;
        while (sample + 1 < weights.size() && passed + static_cast<double>(weights[sample]) <= place)
            passed += static_cast<double>(weights[sample++]);
        sample_of[i] = static_cast<Index>(sample);
    }
    return sample_of;
}

}  // namespace

PointCloud particle_simulation(const PointCloud& cloud, const ParticleSimulationOptions& options,
                               const RunContext& context) {
    check(options, cloud);
    const auto count = static_cast<std::size_t>(options.target_size);
    const std::vector<Reduction> reductions =
        reductions_for(cloud, options.reductions, Representative::Centroid);
    context.checkpoint(0.0);

    const std::vector<Index> chosen = choose_samples(cloud, options, context);
    // Near the middle, floats resolve small moves.
    const Aabb box = [&] { PointCloud local; local.positions = cloud.positions; return bounds(local); }();
    const Vec3f center = (0.5 * (box.min + box.max)).cast<float>();
    std::vector<Vec3f> samples(chosen.size());
    for (std::size_t i = 0; i < chosen.size(); ++i) samples[i] = cloud.positions[chosen[i]] - center;
    Analysis local = analyze(samples, context);
    context.checkpoint(0.3);

    std::vector<float> areas(samples.size()), relative(samples.size(), 1.0F), weights(samples.size());
    for (std::size_t i = 0; i < samples.size(); ++i)
        areas[i] = std::max(local.radius[i] * local.radius[i] * std::numbers::pi_v<float> / kNeighbors, 1e-30F);
    if (options.adaptivity > 0)
        relative = adaptive_spacing(samples, local.variation, areas, options.adaptivity, options.max_grading, context);
    if (!options.regions.empty())
        for (std::size_t i = 0; i < samples.size(); ++i) relative[i] *= region_spacing(options.regions, cloud, chosen[i]);
    for (std::size_t i = 0; i < samples.size(); ++i) weights[i] = areas[i] / (relative[i] * relative[i]);
    const double per_sample = static_cast<double>(count) / static_cast<double>(samples.size());
    bound_weights(weights, static_cast<double>(count), std::max(1.0, 8 * per_sample));
    const std::vector<Index> sample_of = spread(weights, count, options.seed);
    double total = 0;
    for (const float w : weights) total += static_cast<double>(w);
    const double spacing = std::sqrt(2 / std::numbers::sqrt3 * total / static_cast<double>(count));

    std::vector<Vec3f> positions(count);
    for (std::size_t i = 0; i < count; ++i) positions[i] = samples[sample_of[i]];
    std::vector<float> border(samples.size());
    for (std::size_t i = 0; i < samples.size(); ++i) { relative[i] *= static_cast<float>(spacing); border[i] = 0.4F * local.radius[i]; }
    const ParticleSurface surface(samples, local.normals, border, context);
    ParticleRelaxation particles(surface, relative, positions, context);
    unsigned it = 0;
    for (; it < options.max_iterations; ++it) {
        const auto p = particles.step(kSpreadRadius, true);
        if (p.mean_step < options.tolerance) break;
    }
    unsigned it2 = 0;
    for (; it2 < options.max_iterations; ++it2) {
        const auto p = particles.step(kPartRadius, false);
        if (p.largest_overlap < kLargestOverlap) break;
    }
    if (getenv("VERBOSE")) fprintf(stderr, "iterations %u + %u\n", it, it2);
    std::vector<Vec3f> result(particles.positions().begin(), particles.positions().end());
    for (Vec3f& p : result) p += center;
    PointCloud out;
    out.origin = cloud.origin;
    out.positions = result;
    return out;
}

}  // namespace stipple
