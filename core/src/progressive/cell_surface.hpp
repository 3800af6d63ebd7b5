#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

// What the cells in which points lie tell of the surface between them. Both sides of a progressive
// stream ask it, in C++ and in JavaScript, and must find the same, bit by bit: whole numbers, and
// doubles in a settled order.

namespace stipple {

using Cell = std::array<std::int32_t, 3>;

inline std::int64_t distance_sq(const Cell& a, const Cell& b) noexcept {
    std::int64_t sum = 0;
    for (int axis = 0; axis < 3; ++axis)
        sum += std::int64_t{a[axis] - b[axis]} * (a[axis] - b[axis]);
    return sum;
}

/// Cells by the blocks of 2^edge_bits cells a side in which they lie, which they find in O(1).
class CellBlocks {
public:
    CellBlocks() = default;
    CellBlocks(std::span<const Cell> cells, unsigned edge_bits);

    Cell block_of(const Cell& cell) const noexcept {
        return {cell[0] >> edge_bits_, cell[1] >> edge_bits_, cell[2] >> edge_bits_};
    }

    /// The cells in a block and their numbers, least first, until `each` says false.
    void for_each_in(const Cell& block, auto&& each) const {
        if (begin_.empty()) return;
        const std::uint32_t bucket = bucket_of(block);
        for (Index at = begin_[bucket]; at < begin_[bucket + 1]; ++at)
            if (block_of(cells_[at]) == block && !each(numbers_[at], cells_[at])) return;
    }

    /// The least number of a cell in a block, which is in none from then on: not for `for_each_in`.
    /// However many a block holds, each is found in about the same time.
    std::optional<Index> take_from(const Cell& block);

    /// The cells' numbers, those of a block together.
    std::span<const Index> numbers() const noexcept { return numbers_; }

private:
    std::uint32_t bucket_of(const Cell& block) const noexcept;
    Index first_left(Index from) noexcept;

    unsigned edge_bits_ = 0, bucket_bits_ = 0;
    std::vector<Index> begin_;    ///< of each bucket
    std::vector<Index> numbers_;  ///< of the cells, bucket by bucket
    std::vector<Cell> cells_;     ///< as the numbers have them
    std::vector<Index> left_;  ///< once cells are taken: by place, one on the way to the next left
};

/// Of each block that holds one of the cells the first, in their order.
std::vector<Index> first_in_blocks(std::span<const Cell> cells, unsigned edge_bits);

/// The bits of the largest blocks of which at least that share of the number of cells hold one.
unsigned block_bits_for(std::span<const Cell> cells, double share);

inline constexpr unsigned kMostCellNeighbors = 8;

/// Of a cell the nearest others, nearest first.
struct CellNeighbors {
    std::array<Index, kMostCellNeighbors> numbers;
    std::uint8_t count = 0;
    bool shadow = false;  ///< a cell of a lower number is the same one

    std::span<const Index> list() const noexcept { return {numbers.data(), count}; }
};

/// Of each cell, looked for in the 27 blocks around, among the first 32 cells of each; of cells
/// that are the same the first counts. Parallel.
std::vector<CellNeighbors> find_neighbors(std::span<const Cell> cells, const CellBlocks& blocks,
                                          const RunContext& context);

/// The plane that lies closest to some places.
struct CellPlane {
    std::array<double, 3> normal;  ///< unit
    double offset = 0;             ///< of the plane along it, from where places are counted from
    double roughness = 0;          ///< root mean square distance of the places from it
    unsigned axis = 0;             ///< the normal is longest there: z before y before x
};

/// The plane of a place's neighbours, from the place; without it.
CellPlane neighbor_plane(Index number, const CellNeighbors& neighbors,
                         std::span<const Cell> places);

/// The plane of a place and its neighbours, from the place; and the mean distance of its six
/// nearest, 0 where it has none.
struct CellTangent {
    CellPlane plane;
    double spacing = 0;
};
CellTangent tangent_of(Index number, const CellNeighbors& neighbors, std::span<const Cell> places);

}  // namespace stipple
