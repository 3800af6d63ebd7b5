#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace stipple {

/// One cut of space for all levels of a pyramid: each level goes on with the cells of the level
/// before, so that every tile lies in the cell of its parent.
class TileTree {
public:
    static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

    /// What does not fit is cut.
    struct Limits {
        std::size_t points = 65'536;
        float side = std::numeric_limits<float>::infinity();  ///< of the box of a tile's points
    };

    /// The points of a level that lie in one cell: at least one.
    struct Part {
        std::uint32_t parent;  ///< number of the part that the last level with points in this cell
                               ///< had there, counted over all levels; or none
        std::span<Index> points;  ///< ascending; until the next level is added
    };

    /// Cuts the next level: a cell with more points than the limit at the median of its longest
    /// side, one that is too wide in its middle, until all fit or coincide. Both sides of a cut
    /// have points. O(N log(N / limit)), parallel, the same for any number of threads.
    std::vector<Part> add_level(std::span<const Vec3f> points, const Limits& limits,
                                const RunContext& context);

    /// Of all levels.
    std::uint32_t part_count() const noexcept { return parts_; }

    /// Whether there is more than one cell.
    bool is_cut() const noexcept { return cells_.size() > 1; }

    /// The part of the last level in whose cell `p` lies; none where the level has no points.
    std::uint32_t part_at(const Vec3f& p) const noexcept;

private:
    struct Cell {
        int axis = -1;    ///< of the cut; none: a leaf
        float plane = 0;  ///< below it is the first child, from it on the second
        std::uint32_t children = kNone;
        std::uint32_t part = kNone;  ///< of the last level that has points here
    };

    std::vector<Cell> cells_{1};
    std::vector<Index> order_, other_;  ///< of the last level's points, part by part
    std::uint32_t parts_ = 0;           ///< of all levels
    std::uint32_t last_level_ = 0;      ///< first part of the last level
};

}  // namespace stipple
