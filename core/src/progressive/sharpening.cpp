#include "progressive/sharpening.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"

#include <cstddef>

namespace stipple {

std::vector<Vec3d> ways_to_surface(std::span<const Cell> places, unsigned block_bits,
                                   const RunContext& context) {
    constexpr std::size_t kBlock = 4'096;
    constexpr unsigned kLeastNeighbors = 3;
    const std::vector<CellNeighbors> neighbors =
        find_neighbors(places, CellBlocks(places, block_bits), context);
    auto ways = made_in_blocks<std::vector<Vec3d>>(places.size(), context);
    parallel_for_blocks(places.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            if (neighbors[i].count < kLeastNeighbors) {
                ways[i].setZero();
                continue;
            }
            const auto number = static_cast<Index>(i);
            const CellPlane plane = tangent_of(number, neighbors[i], places).plane;
            for (int axis = 0; axis < 3; ++axis) ways[i][axis] = plane.offset * plane.normal[axis];
        }
    });
    return ways;
}

}  // namespace stipple
