#include "contraction/level_bases.hpp"

#include <algorithm>

namespace stipple {

namespace {

constexpr std::uint64_t kPointsOfBase = 3;  // for one of a level, at least

}  // namespace

LevelsOfBase levels_of_base(std::uint64_t base, std::span<const std::uint64_t> sizes) {
    const auto first_for = [sizes](std::uint64_t points) {
        return std::ranges::find_if(
            sizes, [&](std::uint64_t size) { return size <= points / kPointsOfBase; });
    };
    const auto next = first_for(base);
    if (next == sizes.end()) return {sizes};
    const auto rest = first_for(*next);
    return {{sizes.begin(), rest}, rest == sizes.end() ? 0 : *next};
}

}  // namespace stipple
