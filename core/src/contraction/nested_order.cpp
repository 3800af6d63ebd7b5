#include "contraction/nested_order.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "contraction/contraction.hpp"

#include <algorithm>
#include <array>

namespace stipple {

std::vector<Index> nested_order(std::span<const Vec3f> positions, const RunContext& context) {
    std::vector<ContractionPair> sequence;
    reserve_in_blocks(sequence, positions.size(), context);
    constexpr std::array<std::uint64_t, 1> kOne = {1};
    Index left = 0;
    contract(
        positions, {}, kOne, {.placement = Placement::EndPoint, .sequence = &sequence},
        [&](ContractionSnapshot&& snapshot) { left = snapshot.samples.front(); }, context);

    const std::size_t n = positions.size();
    std::vector<Index> order;
    reserve_in_blocks(order, n, context);
    order.push_back(left);
    for_blocks_in_order(n, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = std::max<std::size_t>(begin, 1); i < end; ++i)
            order.push_back(sequence[n - 1 - i].second);
    });
    return order;
}

}  // namespace stipple
