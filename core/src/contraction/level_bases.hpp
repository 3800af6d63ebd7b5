#pragma once

#include "stipple/run_context.hpp"

#include <cmath>
#include <cstdint>
#include <span>
#include <utility>

namespace stipple {

/// Levels that are made of one base: of the cloud, or of a level that has at least three times
/// their points.
struct LevelsOfBase {
    std::span<const std::uint64_t> sizes;
    std::uint64_t next_base =
        0;  ///< of these sizes, the base of the levels after; 0: there are none
};

/// @param base  its points.
/// @param sizes  of all levels that are left, descending. Of levels that are each a quarter of the
/// one before, each is the next base.
LevelsOfBase levels_of_base(std::uint64_t base, std::span<const std::uint64_t> sizes);

/// Calls make(levels, context) with the levels of each base in turn, the cloud's first.
/// @param points  of the cloud.
template <typename Make>
void for_each_base(std::uint64_t points, std::span<const std::uint64_t> sizes,
                   const RunContext& context, Make&& make) {
    constexpr double kOfBase = 0.7;  // of what is left to do
    double done = 0;
    for (std::uint64_t base = points; !sizes.empty();) {
        const LevelsOfBase levels = levels_of_base(base, sizes);
        const double before =
            std::exchange(done, levels.next_base == 0 ? 1 : std::lerp(done, 1.0, kOfBase));
        make(levels, context.part(before, done));
        sizes = sizes.subspan(levels.sizes.size());
        base = levels.next_base;
    }
}

}  // namespace stipple
