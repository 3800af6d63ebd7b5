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

/// The cells that hold points, found by their coordinates.
class Cells {
public:
    Cells(std::span<const GridPoint> points, std::span<const Keyed> sorted)
        : shift_(cell_level(sorted)),
          cell_of_(points.size()),
          place_of_(points.size()),
          members_(points.size()) {
        for (std::size_t i = 0; i < sorted.size(); ++i) {
            const bool begins =
                i == 0 || sorted[i].key >> 3 * shift_ != sorted[i - 1].key >> 3 * shift_;
            if (begins) cells_.push_back({static_cast<Index>(i), 0});
            members_[i] = {points[sorted[i].index], sorted[i].index};
            ++cells_.back().count;
            place_of_[sorted[i].index] = static_cast<Index>(i);
            cell_of_[sorted[i].index] = static_cast<Index>(cells_.size() - 1);
        }
        slots_.resize(std::bit_ceil(2 * cells_.size()));
        for (std::size_t c = 0; c < cells_.size(); ++c) {
            const GridPoint& p = members_[cells_[c].begin].position;
            const std::uint64_t key = key_of(p[0] >> shift_, p[1] >> shift_, p[2] >> shift_);
            std::size_t slot = hash(key);
            while (slots_[slot].key != 0) slot = (slot + 1) & (slots_.size() - 1);
            slots_[slot] = {key, static_cast<Index>(c)};
        }
    }

    void remove(Index point) {
        Cell& cell = cells_[cell_of_[point]];
        const Member& last = members_[cell.begin + --cell.count];
        place_of_[last.index] = place_of_[point];
        members_[place_of_[point]] = last;
    }

    /// The nearest point that is left within `reach` cells of `p`, or nothing.
    const Index* nearest(const GridPoint& p, int reach) const {
        Search search{p};
        const std::array<int, 3> at = {p[0] >> shift_, p[1] >> shift_, p[2] >> shift_};
        look(at, search);
        for (int ring = 1; ring <= reach && !ends_before(ring, at, search); ++ring)
            look_around(at, ring, search);
        return search.found;
    }

private:
    struct Cell {
        Index begin, count;
    };
    struct Member {
        GridPoint position;
        Index index;
    };
    struct Slot {
        std::uint64_t key = 0;  ///< 0: free
        Index cell = 0;
    };
    struct Search {
        GridPoint from;
        std::uint64_t best = std::numeric_limits<std::uint64_t>::max();
        const Index* found = nullptr;
    };

    static std::uint64_t square(std::int64_t v) noexcept {
        return static_cast<std::uint64_t>(v * v);
    }

    static std::uint64_t key_of(int x, int y, int z) noexcept {
        return std::uint64_t{1} << 63U | static_cast<std::uint64_t>(x) << 32U |
               static_cast<std::uint64_t>(y) << 16U | static_cast<std::uint64_t>(z);
    }
    std::size_t hash(std::uint64_t key) const noexcept {
        return key * 0x9E3779B97F4A7C15U >> 20U & (slots_.size() - 1);
    }

    /// From a coordinate to the cell `step` further on.
    std::int64_t gap(std::int64_t coordinate, std::int64_t cell, int step) const noexcept {
        if (step == 0) return 0;
        return step > 0 ? ((cell + step) << shift_) - coordinate
                        : coordinate - ((cell + step + 1) << shift_) + 1;
    }

    /// Whether no cell so many cells away is nearer than what was found.
    bool ends_before(int ring, const std::array<int, 3>& at, const Search& search) const noexcept {
        std::int64_t least = std::numeric_limits<std::int64_t>::max();
        for (std::size_t axis = 0; axis < 3; ++axis) {
            for (const int step : {-ring, ring})
                least = std::min(least, gap(search.from[axis], at[axis], step));
        }
        return square(least) >= search.best;
    }

    void look(const std::array<int, 3>& cell, Search& search) const {
        const std::uint64_t key = key_of(cell[0], cell[1], cell[2]);
        std::size_t slot = hash(key);
        for (; slots_[slot].key != key; slot = (slot + 1) & (slots_.size() - 1))
            if (slots_[slot].key == 0) return;
        constexpr Index kMost = 48;  // of a crowd not all are looked at
        const Cell& c = cells_[slots_[slot].cell];
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

    void look_around(const std::array<int, 3>& at, int ring, Search& search) const {
        const int last = 0xFFFF >> shift_;
        const auto& p = search.from;
        for (int dx = -ring; dx <= ring; ++dx) {
            const std::uint64_t gap_x = square(gap(p[0], at[0], dx));
            if (gap_x >= search.best || at[0] + dx < 0 || at[0] + dx > last) continue;
            for (int dy = -ring; dy <= ring; ++dy) {
                const std::uint64_t gap_xy = gap_x + square(gap(p[1], at[1], dy));
                if (gap_xy >= search.best || at[1] + dy < 0 || at[1] + dy > last) continue;
                const bool side = std::max(std::abs(dx), std::abs(dy)) == ring;
                for (int dz = -ring; dz <= ring; dz += side ? 1 : 2 * ring) {
                    if (gap_xy + square(gap(p[2], at[2], dz)) >= search.best) continue;
                    if (at[2] + dz < 0 || at[2] + dz > last) continue;
                    look({at[0] + dx, at[1] + dy, at[2] + dz}, search);
                }
            }
        }
    }

    unsigned shift_;
    std::vector<Cell> cells_;
    std::vector<Index> cell_of_;   ///< by point
    std::vector<Index> place_of_;  ///< among the members, by point
    std::vector<Member> members_;  ///< of the cells, those that are left first
    std::vector<Slot> slots_;
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
    constexpr int kReach = 2;
    while (true) {
        order.push_back(at);
        visited[at] = true;
        cells.remove(at);
        if (order.size() == points.size()) return order;
        if (const Index* const near = cells.nearest(points[at], kReach)) {
            at = *near;
        } else {
            while (visited[sorted[next].index]) ++next;
            at = sorted[next].index;
        }
    }
}

}  // namespace stipple
