#include "particles/particle_spread.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/random.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

// Follows: Pauly, Gross, Kobbelt 2002, §3.3. Particles are not drawn each by itself: the samples
// follow each other along a space-filling curve, and a particle falls wherever their shares add up
// to one more (systematic sampling). Every stretch of the curve, and so every part of the surface,
// gets the number it is due to within one, and what is left to relax is local.

namespace stipple {

namespace {

constexpr Index kBetweenChecks = 65'536;

double sum_of(std::span<const float> values) {
    return std::accumulate(values.begin(), values.end(), 0.0, [](double sum, float value) {
        return sum + static_cast<double>(value);
    });
}

/// Where particle `rank` of the `of` at a sample starts: on a spiral over the sample's area.
Vec3f place_around(const SurfaceSamples& samples, Index sample, std::size_t rank, std::size_t of,
                   double turn) {
    if (rank == 0) return samples.positions[sample];
    const Vec3d normal = samples.planes[sample].normal.cast<double>();
    const Vec3d u = normal.unitOrthogonal(), v = normal.cross(u);
    constexpr double kGoldenAngle = 2.39996322972865332;
    const double angle = kGoldenAngle * static_cast<double>(rank) + 2 * std::numbers::pi * turn;
    const double radius =
        std::sqrt(static_cast<double>(samples.planes[sample].area()) / std::numbers::pi *
                  static_cast<double>(rank) / static_cast<double>(of));
    return samples.positions[sample] +
           (radius * (std::cos(angle) * u + std::sin(angle) * v)).cast<float>();
}

}  // namespace

std::vector<float> particle_shares(std::span<const float> areas, std::span<const float> spacing,
                                   std::span<const std::uint8_t> rough, std::size_t count,
                                   const RunContext& context) {
    std::vector<float> shares(areas.size());
    for_blocks_in_order(shares.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) shares[i] = areas[i] / (spacing[i] * spacing[i]);
    });
    const auto particles = static_cast<double>(count);
    constexpr double kMost = 4;
    const double bound = kMost * particles / static_cast<double>(shares.size());
    double scale = particles / sum_of(shares);
    // What is cut off one falls to the others, of which more are cut off then.
    for (std::size_t cut = 0;;) {
        const double limit = bound / scale;
        double rest = 0;
        std::size_t beyond = 0;
        for_blocks_in_order(shares.size(), context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                const bool is_cut = rough[i] != 0 && static_cast<double>(shares[i]) >= limit;
                rest += is_cut ? 0 : static_cast<double>(shares[i]);
                beyond += is_cut ? 1 : 0;
            }
        });
        const double left = particles - bound * static_cast<double>(beyond);
        if (beyond == cut || rest == 0 || left <= 0) break;
        cut = beyond;
        scale = left / rest;
    }
    for_blocks_in_order(shares.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const double share = static_cast<double>(shares[i]) * scale;
            shares[i] = static_cast<float>(rough[i] != 0 ? std::min(bound, share) : share);
        }
    });
    return shares;
}

std::vector<float> sample_areas(const SurfaceSamples& samples, const RunContext& context) {
    constexpr float kMost = 8;  // of the upper quartile
    auto areas = made_in_blocks<std::vector<float>>(samples.size(), context);
    parallel_for_blocks(samples.size(), 1'024, context, [&](std::size_t begin, std::size_t end) {
        std::vector<float> around;
        for (std::size_t i = begin; i < end; ++i) {
            around.clear();
            for (const Index j : samples.neighbors_of(i))
                around.push_back(samples.planes[j].area());
            areas[i] = samples.planes[i].area();
            if (around.empty()) continue;
            const auto quartile =
                around.begin() + static_cast<std::ptrdiff_t>(3 * around.size() / 4);
            std::ranges::nth_element(around, quartile);
            areas[i] = std::min(areas[i], kMost * *quartile);
        }
    });
    return areas;
}

std::vector<std::uint8_t> rough_samples(const SurfaceSamples& samples, const RunContext& context) {
    constexpr float kRough = 0.05F;  // sigma_n, which is 1/3 where points lie all around
    auto rough = made_in_blocks<std::vector<std::uint8_t>>(samples.size(), context);
    for_blocks_in_order(rough.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) rough[i] = samples.variation[i] > kRough;
    });
    return rough;
}

SpreadParticles spread_particles(const SurfaceSamples& samples, std::span<const float> shares,
                                 std::size_t count, std::uint64_t seed, const RunContext& context) {
    const double pace = sum_of(shares) / static_cast<double>(count), start = random_unit(seed, 0);
    SpreadParticles particles;
    particles.positions.reserve(count);
    particles.samples.reserve(count);
    double passed = 0;
    for (Index sample = 0; sample < shares.size(); ++sample) {
        if (sample % kBetweenChecks == 0) context.throw_if_stopped();
        passed += static_cast<double>(shares[sample]);
        const bool is_last = sample + 1 == shares.size();
        const double due =
            is_last ? static_cast<double>(count)
                    : std::clamp(std::ceil(passed / pace - start), 0.0, static_cast<double>(count));
        const auto here = static_cast<std::size_t>(due) - particles.positions.size();
        for (std::size_t rank = 0; rank < here; ++rank) {
            particles.samples.push_back(sample);
            particles.positions.push_back(
                place_around(samples, sample, rank, here, random_unit(seed, sample + 1)));
        }
    }
    return particles;
}

}  // namespace stipple
