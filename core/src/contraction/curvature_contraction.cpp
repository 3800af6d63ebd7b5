#include "contraction/curvature_contraction.hpp"

#include "analysis/tangent_plane.hpp"
#include "base/first_touch.hpp"
#include "base/gaussian.hpp"
#include "base/parallel_for.hpp"
#include "contraction/contraction_relaxation.hpp"
#include "neighbors/nearest_lists.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

// A linear moving least squares surface lies inside of a curved one by a part of |H| s^2, with H
// the mean curvature and s the distance of the points. Of all ways to spread a number of points,
// one whose density goes as the square root of |H| has the least of that on average; and points
// that minimise the sum of w d^2 have a density that goes as the square root of w (Gersho 1979).
// Here, where planes count too and contraction is greedy, w = H^2 was found to do better than |H|.

namespace stipple {

namespace {

constexpr std::size_t kBlock = 512;
constexpr std::uint64_t kSamplesPerSurvivor = 8;
constexpr unsigned kNeighbors = 12, kRelaxations = 1;

/// Shares of the progress: of the contraction to samples; and of what is made of them, to where
/// each is held, contracted, shared out and taken by the caller.
constexpr double kOfSamples = 0.15;
constexpr double kToHeld = 0.1, kToContracted = 0.4, kToRelaxed = 0.45;

/// The weight of the squared distance to a sample, as a part of that of its planes, where the
/// surface bends as it does on average; and the most it can be.
constexpr float kPointWeight = 0.01F, kMostPointWeight = 1;

/// What a point's nearest tell of the surface.
struct Bend {
    Vec3f normal = Vec3f::Zero();
    float curvature = 0;  ///< on the side of the normal
    float area = 0;
};

Bend bend_of(std::span<const Vec3d> edges) {
    double mean_sq = 0;
    for (const Vec3d& e : edges) mean_sq += e.squaredNorm() / static_cast<double>(edges.size());
    if (!(mean_sq > 0)) return {};
    const Vec3d normal = normal_from(edges);
    const double per_h_sq = 1.125 / mean_sq;  // h = r / 1.5, with r the radius of an even disc
    double total = 1, height = 0;
    for (const Vec3d& e : edges) {
        const double weight = gaussian(per_h_sq * e.squaredNorm());
        total += weight;
        height += weight * normal.dot(e);
    }
    return {normal.cast<float>(), static_cast<float>(height / (total * mean_sq)),
            static_cast<float>(mean_sq)};
}

/// Adds the squared distance to each sample to its quadric.
/// @param input  number of the points that samples stand for: the sum of what quadrics weigh goes
/// as it.
void hold_curved(SharedSamples& samples, std::size_t input, const RunContext& context) {
    const std::size_t n = samples.positions.size();
    const Bends bends = bends_of(samples.positions, context);
    double bent = 0, area = 0;
    for_blocks_in_order(n, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            bent += static_cast<double>(bends.areas[i] * bends.curvatures[i]);
            area += static_cast<double>(bends.areas[i]);
        }
    });
    if (!(area > 0)) return;
    constexpr double kFlat = 0.01;  // of samples whose size is about 1: less is rounding
    const auto per_mean = static_cast<float>(1 / (bent / area + kFlat));
    // As quadrics have it, from 6 neighbours; the i-th is as far, squared, as i.
    const float per_area = 7.0F / (kNeighbors + 1) * static_cast<float>(input);
    parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const float bend = per_mean * bends.curvatures[i];
            const float weight =
                per_area * bends.areas[i] * std::min(kPointWeight * bend * bend, kMostPointWeight);
            samples.quadrics[i].xx += weight;
            samples.quadrics[i].yy += weight;
            samples.quadrics[i].zz += weight;
        }
    });
}

void multiply(std::vector<Vec3f>& points, float factor, const RunContext& context) {
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) points[i] *= factor;
    });
}

/// Of the survivors: each the sum over its samples, relative to its own position.
std::vector<StoredQuadric> quadrics_of(std::span<const Vec3f> survivors,
                                       const SharedSamples& samples, const RunContext& context) {
    auto sums = made_in_blocks<std::vector<Quadric>>(survivors.size(), context);
    for_blocks_in_order(samples.positions.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const Index to = samples.survivor_of[i];
            sums[to] =
                sums[to] + referred_to(Quadric(samples.quadrics[i]),
                                       (survivors[to] - samples.positions[i]).cast<double>());
        }
    });
    auto quadrics = made_in_blocks<std::vector<StoredQuadric>>(survivors.size(), context);
    parallel_for_blocks(sums.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) quadrics[i] = StoredQuadric(sums[i]);
    });
    return quadrics;
}

void change_unit(std::vector<StoredQuadric>& quadrics, float factor, const RunContext& context) {
    parallel_for_blocks(quadrics.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) quadrics[i] = in_unit(quadrics[i], factor);
    });
}

/// @param scale  at which the samples' quadrics are.
/// @param points  that the samples stand for.
/// @param is_next  whether the quadrics of the survivors are wanted.
ContractionSnapshot contracted(ContractionSnapshot&& found, float scale, std::size_t points,
                               std::uint64_t count, unsigned k, bool is_next,
                               const RunContext& context) {
    SharedSamples samples{std::move(found.positions), std::move(found.quadrics), {}};
    multiply(samples.positions, scale, context);
    hold_curved(samples, points, context);
    context.checkpoint(kToHeld);
    ContractionSnapshot result;
    // Their largest coordinate can be smaller than that of the input.
    const auto larger = static_cast<float>(contraction_scale(samples.positions, context));
    multiply(samples.positions, larger, context);
    change_unit(samples.quadrics, larger, context);
    contract(
        samples.positions, samples.quadrics, std::span(&count, 1), {.k = k},
        [&](ContractionSnapshot&& s) { result = std::move(s); },
        context.part(kToHeld, kToContracted));
    samples.survivor_of = std::move(result.survivor_of);
    relax(samples, result.positions, kRelaxations, context);
    context.checkpoint(kToRelaxed);
    result.quadrics.clear();
    if (is_next) {
        result.quadrics = quadrics_of(result.positions, samples, context);
        change_unit(result.quadrics,
                    static_cast<float>(contraction_scale(result.positions, context)), context);
    }
    multiply(result.positions, 1 / (larger * scale), context);
    result.survivor_of = std::move(found.survivor_of);
    for_blocks_in_order(result.survivor_of.size(), context,
                        [&](std::size_t begin, std::size_t end) {
                            for (std::size_t i = begin; i < end; ++i)
                                result.survivor_of[i] = samples.survivor_of[result.survivor_of[i]];
                        });
    return result;
}

/// As a contraction to all of them.
ContractionSnapshot all_of(const CurvatureInput& input, const RunContext& context) {
    ContractionSnapshot all;
    all.positions.assign(input.positions.begin(), input.positions.end());
    all.quadrics.assign(input.quadrics.begin(), input.quadrics.end());
    all.survivor_of = made_in_blocks<std::vector<Index>>(input.positions.size(), context);
    std::iota(all.survivor_of.begin(), all.survivor_of.end(), Index{0});
    return all;
}

}  // namespace

Bends bends_of(std::span<const Vec3f> points, const RunContext& context) {
    const NearestLists lists = nearest_lists(points, kNeighbors, context);
    std::vector<Bend> own(points.size());
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        std::vector<Vec3d> edges;
        for (std::size_t i = begin; i < end; ++i) {
            edges.clear();
            for (const Index j : lists.of(i))
                edges.push_back((points[j] - points[i]).cast<double>());
            if (edges.size() >= 2) own[i] = bend_of(edges);
        }
    });
    Bends bends{std::vector<float>(points.size()), std::vector<float>(points.size())};
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            float sum = own[i].curvature;
            for (const Index j : lists.of(i))
                sum += own[i].normal.dot(own[j].normal) < 0 ? -own[j].curvature : own[j].curvature;
            bends.curvatures[i] = std::abs(sum) / static_cast<float>(lists.of(i).size() + 1);
            bends.areas[i] = own[i].area;
        }
    });
    return bends;
}

void contract_by_curvature(const CurvatureInput& input, std::span<const std::uint64_t> counts,
                           const ContractionOptions& options, const OnContracted& on_snapshot,
                           const RunContext& context) {
    const std::size_t n = input.positions.size();
    const std::size_t points = input.points == 0 ? n : input.points;
    std::vector<std::uint64_t> sample_counts;
    for (const std::uint64_t count : counts)
        sample_counts.push_back(std::min<std::uint64_t>(n, kSamplesPerSurvivor * count));
    const auto all = static_cast<double>(
        std::accumulate(sample_counts.begin(), sample_counts.end(), std::uint64_t{0}));
    const auto scale = static_cast<float>(contraction_scale(input.positions, context));
    double found = 0, made = 0;  // samples, and snapshots of them: how far both are, in turns
    const auto telling = [&](double& of, double from, double to) -> RunContext {
        const auto tell = [&, from, to](double fraction) {
            of = std::lerp(from, to, fraction);
            context.checkpoint(std::lerp(made, found, kOfSamples));
        };
        return {context.stop, tell, context.threads};
    };
    std::size_t at = 0;
    const auto make = [&](ContractionSnapshot&& samples) {
        const double after = made + static_cast<double>(sample_counts[at]) / all;
        const RunContext run = telling(made, made, after);
        on_snapshot(contracted(std::move(samples), scale, points, counts[at], options.k,
                               counts[at] == input.next, run),
                    run.part(kToRelaxed, 1));
        ++at;
    };
    // All are samples where they are few enough: then quadrics are all that a contraction adds.
    while (!input.quadrics.empty() && at < counts.size() && sample_counts[at] == n)
        make(all_of(input, context));
    if (at == counts.size()) return;
    contract(input.positions, input.quadrics, std::span(sample_counts).subspan(at), options, make,
             telling(found, 0, 1));
}

}  // namespace stipple
