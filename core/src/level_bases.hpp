#pragma once

#include <cstdint>
#include <span>

namespace stipple {

/// What a level needs to be made of a finer one instead of the cloud: so many of its points for one
/// of its own, at least. Of levels that are each a quarter of the one before all but the finest are
/// made of the one before.
inline constexpr std::uint64_t kPointsOfBase = 3;

/// The levels that one base is for.
struct LevelsOfBase {
    std::span<const std::uint64_t> sizes;  ///< the first of those that were given
    std::uint64_t next_base = 0;  ///< of these, what the rest begins with; 0: there is none
};

/// @param base  its points, or the cloud's.
/// @param sizes  of all levels that are left, descending.
LevelsOfBase levels_of_base(std::uint64_t base, std::span<const std::uint64_t> sizes);

}  // namespace stipple
