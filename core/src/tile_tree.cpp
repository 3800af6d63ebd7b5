#include "tile_tree.hpp"

#include "parallel_for.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

namespace stipple {

namespace {

struct Cut {
    int axis = -1;  ///< none: the points fit, or coincide
    float plane = 0;
};

/// A plane with points below it and points on or above it.
Cut cut_of(std::span<const Vec3f> points, std::span<Index> members,
           const TileTree::Limits& limits) {
    Vec3f low = points[members.front()], high = low;
    for (const Index i : members) {
        low = low.cwiseMin(points[i]);
        high = high.cwiseMax(points[i]);
    }
    int axis = 0;
    const float side = (high - low).maxCoeff(&axis);
    const bool wide = side > limits.side;
    if (side == 0 || (!wide && members.size() <= limits.points)) return {};

    float plane = low[axis] + 0.5F * side;
    if (!wide) {
        const auto along = [&](Index i) { return points[i][axis]; };
        const auto middle = members.begin() + static_cast<std::ptrdiff_t>(members.size() / 2);
        std::ranges::nth_element(members, middle, {}, along);
        plane = along(*middle);
    }
    // Where many share the least coordinate the plane goes to the next: both sides have points.
    if (plane <= low[axis]) {
        plane = high[axis];
        for (const Index i : members)
            if (points[i][axis] > low[axis]) plane = std::min(plane, points[i][axis]);
    }
    return {axis, plane};
}

}  // namespace

std::vector<TileTree::Part> TileTree::add_level(std::span<const Vec3f> points, const Limits& limits,
                                                const RunContext& context) {
    struct Open {
        std::uint32_t cell;
        std::span<Index> members;
        Cut cut{};
        std::size_t below = 0;  ///< members on the first side
    };
    std::vector<Index> order(points.size());
    std::iota(order.begin(), order.end(), Index{0});
    std::vector<Open> open, closed;
    if (!points.empty()) open.push_back({0, order});

    // The cells of one depth at a time, each on its own.
    while (!open.empty()) {
        parallel_for_blocks(open.size(), 1, context, [&](std::size_t i, std::size_t) {
            Open& o = open[i];
            const Cell& cell = cells_[o.cell];
            o.cut = cell.axis >= 0 ? Cut{cell.axis, cell.plane} : cut_of(points, o.members, limits);
            if (o.cut.axis < 0) return;
            const auto above = std::ranges::partition(
                o.members, [&](Index p) { return points[p][o.cut.axis] < o.cut.plane; });
            o.below = static_cast<std::size_t>(above.begin() - o.members.begin());
        });
        std::vector<Open> next;
        for (const Open& o : open) {
            if (o.cut.axis < 0) {
                closed.push_back(o);
                continue;
            }
            if (cells_[o.cell].axis < 0) {
                const std::uint32_t part = cells_[o.cell].part;
                cells_[o.cell] = {o.cut.axis, o.cut.plane,
                                  static_cast<std::uint32_t>(cells_.size()), part};
                cells_.insert(cells_.end(), 2, Cell{.part = part});
            }
            const std::uint32_t child = cells_[o.cell].children;
            if (o.below > 0) next.push_back({child, o.members.first(o.below)});
            if (o.below < o.members.size()) next.push_back({child + 1, o.members.subspan(o.below)});
        }
        open = std::move(next);
    }

    // In the order of space, so that tiles that follow each other lie near each other.
    std::ranges::sort(closed, {}, [](const Open& o) { return o.members.data(); });
    last_level_ = parts_;
    std::vector<Part> parts(closed.size());
    for (std::size_t i = 0; i < closed.size(); ++i) {
        parts[i].parent = std::exchange(cells_[closed[i].cell].part, parts_++);
        parts[i].points.assign(closed[i].members.begin(), closed[i].members.end());
    }
    parallel_for_blocks(parts.size(), 1, context,
                        [&](std::size_t i, std::size_t) { std::ranges::sort(parts[i].points); });
    return parts;
}

std::uint32_t TileTree::part_at(const Vec3f& p) const noexcept {
    const Cell* cell = &cells_.front();
    while (cell->axis >= 0)
        cell = &cells_[cell->children + (p[cell->axis] < cell->plane ? 0U : 1U)];
    return cell->part == kNone || cell->part < last_level_ ? kNone : cell->part - last_level_;
}

}  // namespace stipple
