#include "level_rounding.hpp"

#include "curve_normals.hpp"
#include "first_touch.hpp"
#include "gaps.hpp"
#include "parallel_for.hpp"
#include "surface_rounding.hpp"

#include <algorithm>
#include <cmath>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 8'192;

/// @param normals  of the surface, where they are known.
std::vector<Vec3f> rounded(std::span<const Vec3f> points, std::span<const Vec3f> normals,
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

LevelGrid LevelRounding::grid(unsigned bits) const {
    if (side == 0) return {1, bits};
    return {side / static_cast<double>((std::uint64_t{1} << bits) - 2), bits};
}

/// For steps no longer than `step`, from 2 to `most`.
unsigned LevelRounding::bits_for(double step, unsigned most) const {
    if (!(step > 0)) return most;
    const double bits = std::ceil(std::log2(side / step + 2));
    return static_cast<unsigned>(std::clamp<double>(bits, kLeastBits, most));
}

LevelGrid LevelRounding::finest_grid(const LevelMeter& meter) const {
    if (!precision || side == 0) {
        // With longer steps than the spacing the points of one part would fall into one place.
        const unsigned apart = meter.spacing() > 0 ? bits_for(meter.spacing(), kMostBits) : 0;
        return grid(std::max(position_bits, apart));
    }
    const double step = 2 * *precision;
    const double bits = std::ceil(std::log2(side / step + 2));
    if (bits > kMostBits) return grid(kMostBits);
    return {step, static_cast<unsigned>(std::max<double>(bits, kLeastBits))};
}

MeasuredLevel LevelRounding::round(MeasuredLevel&& unrounded, LevelGrid& taken,
                                   const LevelMeter& meter, const RunContext& context) const {
    const LevelGrid finest = finest_grid(meter);
    const std::vector<Vec3f>& points = unrounded.points;
    meter.measure_roughly(unrounded, context);
    const double exact = unrounded.mean;
    // Where there are more points they are not worth the time: those who load them have waited
    // already.
    constexpr std::size_t kMost = 131'072;
    const std::vector<Vec3f> normals =
        points.size() <= kMost ? curve_normals(*unrounded.tree, context) : std::vector<Vec3f>();
    const auto try_bits = [&](unsigned bits) {
        MeasuredLevel level(rounded(points, normals, grid(bits), context), context);
        meter.measure_roughly(level, context);
        return level;
    };
    // The variance of what rounding adds, in squared steps, once the surface's fit has smoothed
    // it: measured.
    const double added = normals.empty() ? 0.025 : 0.0025;
    const double limit = (1 + tolerance) * exact;
    const unsigned least = bits_for(0.5 * mean_gap(*unrounded.tree, points.size(), kAskedForGap,
                                                   [&](std::size_t i) { return points[i]; }),
                                    finest.bits);
    const auto at_finest = [&] {
        taken = finest;
        unrounded.tree.reset();  // two trees of a large level would take as much as its source
        return MeasuredLevel(rounded(points, normals, finest, context), context);
    };
    const unsigned wanted = bits_for(exact * std::sqrt(2 * tolerance / added), kMostBits);
    // Many points take a while to be measured with a bit less, which here is hopeless.
    const bool hopeless = wanted > finest.bits && exact > 0 && normals.empty();
    if (hopeless || least >= finest.bits) return at_finest();
    unsigned bits = std::max(least, std::min(wanted, finest.bits - 1));
    MeasuredLevel level = try_bits(bits);
    if (level.mean <= limit) {
        // A bit less doubles the steps: four times the variance, and three times what it adds to
        // the mean at least.
        constexpr double kAtLeast = 3;
        while (bits > least && exact + kAtLeast * (level.mean - exact) <= limit) {
            MeasuredLevel fewer = try_bits(bits - 1);
            if (fewer.mean > limit) break;
            level = std::move(fewer);
            --bits;
        }
    } else {
        while (level.mean > limit && ++bits < finest.bits) level = try_bits(bits);
    }
    if (bits >= finest.bits) return at_finest();
    taken = grid(bits);
    return level;
}

}  // namespace stipple
