#pragma once

#include "pyramid/level_meter.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace stipple {

/// A grid through the middle of the source's box.
struct LevelGrid {
    double step;
    unsigned bits;
    double steps = 1 / step;  ///< of a unit

    std::int32_t at(float coordinate) const noexcept {
        // Of a number above 0 the whole part is what conversion leaves.
        constexpr std::int32_t kAbove = 1 << 30;
        return static_cast<std::int32_t>(static_cast<double>(coordinate) * steps + (kAbove + 0.5)) -
               kAbove;
    }
    Vec3f rounded(const Vec3f& p) const noexcept {
        Vec3f q;
        for (int axis = 0; axis < 3; ++axis) q[axis] = static_cast<float>(at(p[axis]) * step);
        return q;
    }
};

/// Rounds the points of levels to grids. Lengths are those of the meter.
struct LevelRounding {
    /// Of each axis. About the middle floats tell more apart than their 24 bits do of the whole;
    /// the numbers of a grid, which may have its 0 at one end, are those of `LevelGrid::at`.
    static constexpr unsigned kLeastBits = 2, kMostBits = 29;

    double side = 0;                     ///< of the source's box, the longest
    double side_of_most = side;          ///< of that around most points, where strays are far off
    double tolerance = 0;                ///< `LodTileOptions`
    unsigned position_bits = kMostBits;  ///< the same
    std::optional<double> precision{};   ///< the same
    double added = 0;  ///< the variance of what rounding added to the last level, in squared steps

    /// No precision is finer.
    double least_precision() const { return 0.5 * step_of(kMostBits); }
    /// That of the finest level; no level's is finer.
    LevelGrid finest_grid(const LevelMeter& meter) const;

    /// By about the longest steps by which the mean error grows by no more than the tolerance, and
    /// by which points stay apart: two of them to a spacing. Notes what they added.
    MeasuredLevel round(MeasuredLevel&& unrounded, LevelGrid& taken, const LevelMeter& meter,
                        const RunContext& context);

private:
    LevelGrid grid(double step) const;
    double step_of(unsigned bits) const { return step_of(bits, side); }
    static double step_of(unsigned bits, double side);
};

/// Each to the nearest place of the grid.
std::vector<Vec3f> rounded(std::span<const Vec3f> points, const LevelGrid& grid,
                           const RunContext& context);

}  // namespace stipple
