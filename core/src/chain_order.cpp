#include "chain_order.hpp"

#include <algorithm>
#include <bit>
#include <limits>
#include <numeric>
#include <utility>

namespace stipple {

namespace {

struct Keyed {
    std::uint64_t key;
    Index index;
};

/// The bits of a coordinate, each followed by two zeros.
constexpr std::uint64_t spread(std::uint64_t cell) noexcept {
    cell = (cell | cell << 16U) & 0x0000FF0000FFU;
    cell = (cell | cell << 8U) & 0x00F00F00F00FU;
    cell = (cell | cell << 4U) & 0x0C30C30C30C3U;
    return (cell | cell << 2U) & 0x249249249249U;
}

std::vector<Keyed> morton_order(std::span<const GridPoint> points) {
    std::vector<Keyed> sorted(points.size()), other(points.size());
    std::uint64_t used = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const auto [x, y, z] = points[i];
        sorted[i] = {spread(x) | spread(y) << 1U | spread(z) << 2U, static_cast<Index>(i)};
        used |= sorted[i].key;
    }
    constexpr unsigned kDigit = 12;
    constexpr std::uint64_t kMask = (std::uint64_t{1} << kDigit) - 1;
    std::vector<Index> places(kMask + 1);
    for (unsigned shift = 0; used >> shift != 0; shift += kDigit) {
        std::ranges::fill(places, 0);
        for (const Keyed& p : sorted) ++places[p.key >> shift & kMask];
        std::exclusive_scan(places.begin(), places.end(), places.begin(), Index{0});
        for (const Keyed& p : sorted) other[places[p.key >> shift & kMask]++] = p;
        sorted.swap(other);
    }
    return sorted;
}

/// The level of the octree whose cells hold about three points where there are any.
unsigned cell_level(std::span<const Keyed> sorted) {
    std::array<std::size_t, 17> parted{};  // neighbours along the curve, by where they part
    for (std::size_t i = 1; i < sorted.size(); ++i)
        ++parted[(std::bit_width(sorted[i - 1].key ^ sorted[i].key) + 2U) / 3];
    unsigned level = 16;
    for (std::size_t cells = 1; level > 0; --level) {
        if (3 * cells >= sorted.size()) break;
        cells += parted[level];
    }
    return level;
}

/// The cells that hold points, found by their coordinates: a table of blocks of 4 x 4 x 4 cells, so
/// that the cells around a point are found near each other in memory.
class Cells {
public:
    Cells(std::span<const GridPoint> points, std::span<const Keyed> sorted)
        : shift_(cell_level(sorted)),
          cell_of_(points.size()),
          place_of_(points.size()),
          members_(points.size()) {
        for (std::size_t i = 0; i < sorted.size(); ++i) {
            const auto begins_at = [&](unsigned level) {
                return i == 0 || sorted[i].key >> 3 * level != sorted[i - 1].key >> 3 * level;
            };
            const Index point = sorted[i].index;
            const GridPoint& p = points[point];
            if (begins_at(shift_ + kBlockBits)) blocks_.push_back({block_key(cell_at(p)), {}});
            if (begins_at(shift_)) {
                blocks_.back().cells[place_in_block(cell_at(p))] =
                    static_cast<Index>(cells_.size() + 1);
                cells_.push_back({static_cast<Index>(i), 0});
            }
            ++cells_.back().count;
            members_[i] = {p, point};
            cell_of_[point] = static_cast<Index>(cells_.size() - 1);
            place_of_[point] = static_cast<Index>(i);
        }
        table_.resize(std::bit_ceil(2 * blocks_.size() + 1));
        for (std::size_t b = 0; b < blocks_.size(); ++b) {
            std::size_t slot = hash(blocks_[b].key);
            while (table_[slot] != 0) slot = (slot + 1) & (table_.size() - 1);
            table_[slot] = static_cast<Index>(b + 1);
        }
    }

    void remove(Index point) {
        Cell& cell = cells_[cell_of_[point]];
        const Member& last = members_[cell.begin + --cell.count];
        place_of_[last.index] = place_of_[point];
        members_[place_of_[point]] = last;
    }

    /// The nearest point that is left within one cell of `p`, or nothing.
    const Index* nearest(const GridPoint& p) {
        Search search{p};
        const CellPlace at = cell_at(p);
        look(at, search);
        std::array<std::array<std::uint64_t, 3>, 3> gaps{};  // squared, by axis and step
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const std::int64_t inside = p[axis] - (std::int64_t{at[axis]} << shift_);
            const std::int64_t side = std::int64_t{1} << shift_;
            gaps[axis] = {square(inside + 1), 0, square(side - inside)};
        }
        for (int x = 0; x < 3; ++x) {
            for (int y = 0; y < 3; ++y) {
                const std::uint64_t gap = gaps[0][x] + gaps[1][y];
                if (gap >= search.best) continue;
                for (int z = 0; z < 3; ++z) {
                    if (gap + gaps[2][z] >= search.best || (x == 1 && y == 1 && z == 1)) continue;
                    look({at[0] + x - 1, at[1] + y - 1, at[2] + z - 1}, search);
                }
            }
        }
        return search.found;
    }

private:
    static constexpr unsigned kBlockBits = 2;
    using CellPlace = std::array<int, 3>;

    struct Cell {
        Index begin, count;
    };
    struct Member {
        GridPoint position;
        Index index;
    };
    struct Block {
        std::uint64_t key;
        std::array<Index, 64> cells;  ///< number + 1; 0: no points
    };
    struct Search {
        GridPoint from;
        std::uint64_t best = std::numeric_limits<std::uint64_t>::max();
        const Index* found = nullptr;
    };

    static std::uint64_t square(std::int64_t v) noexcept {
        return static_cast<std::uint64_t>(v * v);
    }
    CellPlace cell_at(const GridPoint& p) const noexcept {
        return {p[0] >> shift_, p[1] >> shift_, p[2] >> shift_};
    }
    /// Other than those of all other blocks for cells from -1 to 65,536.
    static std::uint64_t block_key(const CellPlace& cell) noexcept {
        const auto part = [](int c) { return static_cast<std::uint64_t>((c >> kBlockBits) + 1); };
        return part(cell[0]) << 40U | part(cell[1]) << 20U | part(cell[2]);
    }
    static std::size_t place_in_block(const CellPlace& cell) noexcept {
        const auto part = [](int c) { return static_cast<std::size_t>(c) & 3U; };
        return part(cell[0]) << 4U | part(cell[1]) << 2U | part(cell[2]);
    }
    std::size_t hash(std::uint64_t key) const noexcept {
        return key * 0x9E3779B97F4A7C15U >> 32U & (table_.size() - 1);
    }

    const Block* block_of(const CellPlace& cell) noexcept {
        const std::uint64_t key = block_key(cell);
        if (key == last_key_) return last_block_;
        last_key_ = key;
        last_block_ = nullptr;
        for (std::size_t slot = hash(key); table_[slot] != 0;
             slot = (slot + 1) & (table_.size() - 1)) {
            const Block& block = blocks_[table_[slot] - 1];
            if (block.key == key) last_block_ = &block;
            if (block.key == key) break;
        }
        return last_block_;
    }

    void look(const CellPlace& cell, Search& search) {
        const Block* const block = block_of(cell);
        if (block == nullptr) return;
        const Index number = block->cells[place_in_block(cell)];
        if (number == 0) return;
        constexpr Index kMost = 48;  // of a crowd not all are looked at
        const Cell& c = cells_[number - 1];
        for (Index i = c.begin; i < c.begin + std::min(c.count, kMost); ++i) {
            const Member& m = members_[i];
            std::uint64_t distance = 0;
            for (std::size_t axis = 0; axis < 3; ++axis)
                distance += square(std::int64_t{m.position[axis]} - search.from[axis]);
            if (distance < search.best) {
                search.best = distance;
                search.found = &m.index;
            }
        }
    }

    unsigned shift_;
    std::vector<Cell> cells_;
    std::vector<Block> blocks_;
    std::vector<Index> table_;     ///< of blocks: number + 1; 0: free
    std::vector<Index> cell_of_;   ///< by point
    std::vector<Index> place_of_;  ///< among the members, by point
    std::vector<Member> members_;  ///< of the cells, those that are left first
    std::uint64_t last_key_ = 0;   ///< of no block
    const Block* last_block_ = nullptr;
};

}  // namespace

std::vector<Index> chain_order(std::span<const GridPoint> points) {
    std::vector<Index> order;
    if (points.empty()) return order;
    order.reserve(points.size());
    const std::vector<Keyed> sorted = morton_order(points);
    Cells cells(points, sorted);
    std::vector<bool> visited(points.size());
    std::size_t next = 0;  // along the curve: all before it are visited
    Index at = sorted[0].index;
    while (true) {
        order.push_back(at);
        visited[at] = true;
        cells.remove(at);
        if (order.size() == points.size()) return order;
        if (const Index* const near = cells.nearest(points[at])) {
            at = *near;
        } else {
            while (visited[sorted[next].index]) ++next;
            at = sorted[next].index;
        }
    }
}

}  // namespace stipple
