#include "pyramid/tile_tree.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "cloud/float4.hpp"

#include <algorithm>
#include <bit>
#include <numeric>
#include <utility>

namespace stipple {

namespace {

struct Cut {
    int axis = -1;  ///< none: the points fit, or coincide
    float plane = 0;
};

/// A number that sorts as the float does, and the float of one.
Index key_of(float value) noexcept {
    constexpr std::uint32_t kSign = 0x80000000U;
    const auto bits = std::bit_cast<std::uint32_t>(value);
    return (bits & kSign) != 0 ? ~bits : bits | kSign;
}
float of_key(Index key) noexcept {
    constexpr std::uint32_t kSign = 0x80000000U;
    return std::bit_cast<float>((key & kSign) != 0 ? key & ~kSign : ~key);
}

struct Box {
    Vec3f low, high;
};

/// By four lanes, of which the last holds what lies behind a point.
Box box_of(std::span<const Vec3f> points, std::span<const Index> members) {
    Box box{points[members.front()], points[members.front()]};
    const auto add = [&](const Vec3f& p) {
        box.low = box.low.cwiseMin(p);
        box.high = box.high.cwiseMax(p);
    };
    const auto last = static_cast<Index>(points.size() - 1);  // nothing lies behind it
    Float4 low = {box.low.x(), box.low.y(), box.low.z(), 0}, high = low;
    for (const Index i : members) {
        if (i == last) {
            add(points[i]);
            continue;
        }
        const Float4 p = load(points[i].data());
        low = smaller(low, p);
        high = larger(high, p);
    }
    add({low[0], low[1], low[2]});
    add({high[0], high[1], high[2]});
    return box;
}

/// A plane with points below it and points on or above it.
/// @param room  for as many numbers.
Cut cut_of(std::span<const Vec3f> points, std::span<const Index> members,
           const TileTree::Limits& limits, std::span<Index> room) {
    const auto [low, high] = box_of(points, members);
    int axis = 0;
    const float side = (high - low).maxCoeff(&axis);
    const bool wide = side > limits.side;
    if (side == 0 || (!wide && members.size() <= limits.points)) return {};

    float plane = low[axis] + 0.5F * side;
    if (!wide) {
        std::ranges::transform(members, room.begin(),
                               [&](Index i) { return key_of(points[i][axis]); });
        const auto middle = room.begin() + static_cast<std::ptrdiff_t>(room.size() / 2);
        std::ranges::nth_element(room, middle);
        plane = of_key(*middle);
    }
    // Where many share the least coordinate the plane goes to the next: both sides have points.
    if (plane <= low[axis]) {
        plane = high[axis];
        for (const Index i : members)
            if (points[i][axis] > low[axis]) plane = std::min(plane, points[i][axis]);
    }
    return {axis, plane};
}

/// Puts the members below the cut first, both sides in the order they had.
/// @return  how many those are.
std::size_t divide(std::span<const Vec3f> points, std::span<const Index> members, const Cut& cut,
                   std::span<Index> room) {
    std::size_t below = 0, above = members.size();
    for (const Index i : members) {
        const bool is_below = points[i][cut.axis] < cut.plane;
        room[is_below ? below : above - 1] = i;
        below += is_below ? 1 : 0;
        above -= is_below ? 0 : 1;
    }
    std::reverse(room.begin() + static_cast<std::ptrdiff_t>(below), room.end());
    return below;
}

}  // namespace

std::vector<TileTree::Part> TileTree::add_level(std::span<const Vec3f> points, const Limits& limits,
                                                const RunContext& context) {
    struct Open {
        std::uint32_t cell;
        std::size_t begin, size;
        Index* members;
        Cut cut{};
        std::size_t below = 0;  ///< members on the first side
    };
    // From the one to the other and back; what is closed stays where it is.
    resize_in_blocks(order_, points.size(), context);
    resize_in_blocks(other_, points.size(), context);
    std::iota(order_.begin(), order_.end(), Index{0});
    std::vector<Open> open, closed;
    if (!points.empty()) open.push_back({0, 0, points.size(), order_.data()});

    // The cells of one depth at a time, each on its own.
    while (!open.empty()) {
        parallel_for_blocks(open.size(), 1, context, [&](std::size_t i, std::size_t) {
            Open& o = open[i];
            const Cell& cell = cells_[o.cell];
            const std::span<const Index> members(o.members, o.size);
            const std::span<Index> room = std::span(other_).subspan(o.begin, o.size);
            o.cut =
                cell.axis >= 0 ? Cut{cell.axis, cell.plane} : cut_of(points, members, limits, room);
            if (o.cut.axis < 0) return;
            o.below = divide(points, members, o.cut, room);
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
            const std::size_t middle = o.begin + o.below, above = o.size - o.below;
            if (o.below > 0) next.push_back({child, o.begin, o.below, &other_[o.begin]});
            if (above > 0) next.push_back({child + 1, middle, above, &other_[middle]});
        }
        open = std::move(next);
        order_.swap(other_);
    }

    // In the order of space, so that tiles that follow each other lie near each other.
    std::ranges::sort(closed, {}, &Open::begin);
    last_level_ = parts_;
    std::vector<Part> parts(closed.size());
    for (std::size_t i = 0; i < closed.size(); ++i) {
        parts[i].parent = std::exchange(cells_[closed[i].cell].part, parts_++);
        parts[i].points = {closed[i].members, closed[i].size};
    }
    return parts;
}

std::uint32_t TileTree::part_at(const Vec3f& p) const noexcept {
    const Cell* cell = &cells_.front();
    while (cell->axis >= 0)
        cell = &cells_[cell->children + (p[cell->axis] < cell->plane ? 0U : 1U)];
    return cell->part == kNone || cell->part < last_level_ ? kNone : cell->part - last_level_;
}

}  // namespace stipple
