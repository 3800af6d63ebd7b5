#include "rendering/voronoi_cell.hpp"

#include "cloud/float4.hpp"

#include <algorithm>

// Follows: Jarvis 1973 (gift wrapping), of bisectors in place of points: along one of them the next
// edge is that of the place whose bisector comes first.

namespace stipple {

namespace {

constexpr float kNowhere = 1e30F;
constexpr std::size_t kFew = 12;  // mostly all that have an edge

struct Following {
    int next;
    bool is_direct;
    Eigen::Vector2f corner;  ///< where the bisectors meet
};

/// What follows on the edge of a place among the first `count`, which are whole fours.
Following following(const PlanarPlaces& places, std::size_t count, int neighbor, bool clockwise) {
    constexpr float kRounding = 1e-6F;
    const auto n = static_cast<std::size_t>(neighbor);
    const Float4 nowhere = splat(kNowhere);
    const Float4 ax = splat(places.x[n]), ay = splat(places.y[n]);
    const Float4 along_x = clockwise ? ay : -ay, along_y = clockwise ? -ax : ax;
    Float4 first = nowhere, least = nowhere;
    Int4 which = Int4{} + VoronoiCell::kOpen, lanes = {0, 1, 2, 3};
    for (std::size_t i = 0; i < count; i += 4, lanes += 4) {
        const Float4 x = load(&places.x[i]), y = load(&places.y[i]);
        const Float4 length_sq = load(&places.length_sq[i]);
        const Int4 is_other = ((x != ax) | (y != ay)) & (length_sq > 0.0F);
        // Twice how far the middle of the way to the neighbour is on this side of their bisector,
        // and how much nearer a step along the edge leads to it, to scale.
        const Float4 margin = length_sq - (ax * x + ay * y);
        const Float4 nearer = along_x * x + along_y * y;
        const Float4 sure = is_other ? margin - kRounding * length_sq : nowhere;
        least = sure < least ? sure : least;
        const Float4 way = is_other & (nearer > 0.0F) ? margin / nearer : nowhere;
        which = way < first ? lanes : which;
        first = way < first ? way : first;
    }
    Following found{VoronoiCell::kOpen,
                    least[0] > 0 && least[1] > 0 && least[2] > 0 && least[3] > 0,
                    Eigen::Vector2f::Zero()};
    float soonest = kNowhere;
    for (int lane = 0; lane < 4; ++lane) {
        if (first[lane] >= soonest) continue;
        soonest = first[lane];
        found.next = which[lane];
    }
    if (found.next != VoronoiCell::kOpen)
        found.corner = {0.5F * (ax[0] + soonest * along_x[0]),
                        0.5F * (ay[0] + soonest * along_y[0])};
    return found;
}

}  // namespace

void PlanarPlaces::reset(std::size_t n) {
    const std::size_t padded = (n + 3) / 4 * 4;
    x.assign(padded, 0);
    y.assign(padded, 0);
    length_sq.assign(padded, 0);
}

bool VoronoiCell::is_known(int neighbor) const noexcept {
    return std::ranges::find(edges_, neighbor, &Edge::neighbor) != edges_.end();
}

bool VoronoiCell::is_cut(const PlanarPlaces& places, std::size_t from) const noexcept {
    for (const Edge& edge : edges_) {
        const Float4 x = splat(edge.corner.x()), y = splat(edge.corner.y());
        for (std::size_t i = from; i < places.x.size(); i += 4) {
            const Float4 twice = 2.0F * (x * load(&places.x[i]) + y * load(&places.y[i]));
            if (lane_bits(twice > load(&places.length_sq[i])) != 0) return true;
        }
    }
    return false;
}

void VoronoiCell::walk(const PlanarPlaces& places, std::size_t count, int start) {
    edges_.clear();
    for (int at = start; at != kOpen && !is_known(at); at = edges_.back().next) {
        const auto [next, is_direct, corner] = following(places, count, at, false);
        edges_.push_back({at, next, is_direct, corner});
    }
    is_closed_ = edges_.back().next != kOpen;
    if (is_closed_) return;
    // Clockwise, each edge ends where the one after it was left.
    int after = start;
    Following before = following(places, count, start, true);
    while (before.next != kOpen && !is_known(before.next)) {
        const Following on = following(places, count, before.next, true);
        edges_.push_back({before.next, after, on.is_direct, before.corner});
        after = before.next;
        before = on;
    }
}

void VoronoiCell::find(const PlanarPlaces& places) {
    edges_.clear();
    is_closed_ = false;
    const auto nearest = std::ranges::find_if(places.length_sq, [](float sq) { return sq > 0; });
    if (nearest == places.length_sq.end()) return;
    const auto start = static_cast<int>(nearest - places.length_sq.begin());
    const std::size_t all = places.x.size();
    if (all > kFew && start < static_cast<int>(kFew)) {
        walk(places, kFew, start);
        if (is_closed_ && !is_cut(places, kFew)) return;
    }
    walk(places, all, start);
}

}  // namespace stipple
