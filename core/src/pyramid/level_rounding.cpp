#include "pyramid/level_rounding.hpp"

#include "analysis/curve_normals.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "neighbors/gaps.hpp"
#include "pyramid/surface_rounding.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 8'192;
constexpr double kCloser = 1.04;  // what a step is to be longer by, to be worth a try
constexpr double kBetter = 1.15;  // the same where one is known that does
// Parts of the tolerance: to be sure, in spite of places measured at by chance, and to aim at.
constexpr double kSure = 0.9, kAim = 0.75;
constexpr unsigned kMostTries = 4;

/// @param normals  of the surface, where they are known.
std::vector<Vec3f> rounded(std::span<const Vec3f> points, std::span<const NormalAndBend> normals,
                           const LevelGrid& grid, const RunContext& context) {
    if (normals.empty()) return rounded(points, grid, context);
    auto decoded = made_in_blocks<std::vector<Vec3f>>(points.size(), context);
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        round_to_surface(points.subspan(begin, end - begin), normals.subspan(begin, end - begin),
                         grid.step, &decoded[begin]);
    });
    return decoded;
}

}  // namespace

std::vector<Vec3f> rounded(std::span<const Vec3f> points, const LevelGrid& grid,
                           const RunContext& context) {
    auto decoded = made_in_blocks<std::vector<Vec3f>>(points.size(), context);
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) decoded[i] = grid.rounded(points[i]);
    });
    return decoded;
}

LevelGrid LevelRounding::grid(double step) const {
    if (side == 0) return {1, kLeastBits};
    const double bits = std::ceil(std::log2(side / step + 2));
    return {step, static_cast<unsigned>(std::max<double>(bits, kLeastBits))};
}

double LevelRounding::step_of(unsigned bits, double side) {
    return side / static_cast<double>((std::uint64_t{1} << bits) - 2);
}

LevelGrid LevelRounding::finest_grid(const LevelMeter& meter) const {
    if (side == 0) return {1, position_bits};
    if (precision) return grid(2 * *precision);
    // With longer steps than the spacing the points of one part would fall into one place.
    const double longest = meter.spacing() > 0 ? meter.spacing() : side;
    return grid(
        std::max(std::min(step_of(position_bits, side_of_most), longest), step_of(kMostBits)));
}

MeasuredLevel LevelRounding::round(MeasuredLevel&& unrounded, LevelGrid& taken,
                                   const LevelMeter& meter, const RunContext& context) {
    const LevelGrid finest = finest_grid(meter);
    const std::vector<Vec3f>& points = unrounded.points;
    meter.measure_at_some(unrounded, context);
    const double exact = unrounded.mean, exact_at_a_glance = meter.mean_at_a_glance(unrounded);
    // Where there are more points they are not worth the time: those who load them have waited
    // already.
    constexpr std::size_t kMost = 131'072;
    std::vector<NormalAndBend> normals;
    // A tree of a crowd has one point of each place alone.
    if (points.size() <= kMost && unrounded.apart.empty())
        normals = curve_normals(*unrounded.tree, context);
    const double gap = mean_gap(*unrounded.tree, points.size(), kAskedForGap,
                                [&](std::size_t i) { return points[i]; });
    double longest = std::min(0.5 * gap, step_of(kLeastBits));  // of the steps that may do
    double fits = finest.step;                                  // a step that does
    // The variance of what rounding adds, in squared steps, once the surface's fit has smoothed
    // it: of smooth surfaces, or what it was at the last level. It only tells where to begin.
    const double least_added = normals.empty() ? 0.015 : 0.0015;
    const double likely = exact * std::sqrt(2 * kAim * tolerance / std::max(added, least_added));
    // Many points take a while to be measured where rounding is hopeless.
    const bool hopeless = likely < finest.step && exact > 0 && normals.empty();
    std::optional<MeasuredLevel> best;
    double step = exact > 0 ? std::max(likely, kCloser * fits) : longest;
    for (unsigned tries = 0; !hopeless && tries < kMostTries; ++tries) {
        step = std::min(step, longest);
        if (step < (best ? kBetter : kCloser) * fits) break;
        MeasuredLevel level(rounded(points, normals, grid(step), context), context);
        meter.glance(level, context);
        double rise = level.mean - exact_at_a_glance;
        if (rise <= tolerance * exact) {
            meter.measure_at_some(level, context);
            rise = level.mean - exact;
        }
        added = 2 * exact * std::max(0.0, rise) / (step * step);
        // As a part of what is tolerated; it grows with the square of the step, or a little less.
        const double share = rise > 0 ? rise / (tolerance * exact) : 0;
        if (share > kSure) {
            longest = step / kCloser;
            step *= std::max(0.25, std::pow(kAim / share, 0.55));
        } else {
            best = std::move(level);
            taken = grid(step);
            fits = step;
            step *= std::min(4.0, std::sqrt(kAim / share));
        }
    }
    if (best) return std::move(*best);
    taken = finest;
    unrounded.tree.reset();  // two trees of a large level would take as much as its source
    return MeasuredLevel(rounded(points, normals, finest, context), context);
}

}  // namespace stipple
