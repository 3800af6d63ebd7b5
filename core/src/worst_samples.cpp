#include "worst_samples.hpp"

#include "first_touch.hpp"
#include "tree_search.hpp"
#include "until_stopped.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace stipple {

namespace {

constexpr std::size_t kAround = 8, kMostAtOnce = 32, kOneOf = 500;
constexpr unsigned kMostRounds = 8;
constexpr double kNear = 0.05, kBeside = 0.01;  // in h
constexpr double kGone = 5;                     // times as far as the neighbour is

/// Corners of a cube around the place.
std::array<Vec3f, kAround> around(const Vec3f& place, double radius) {
    const auto step = static_cast<float>(radius / std::sqrt(3.0));
    std::array<Vec3f, kAround> places;
    for (std::size_t c = 0; c < kAround; ++c)
        places[c] =
            place + step * Vec3f(c & 1 ? 1.F : -1.F, c & 2 ? 1.F : -1.F, c & 4 ? 1.F : -1.F);
    return places;
}

std::vector<Foot> feet_of(const FootFinder& surface, std::span<const Vec3f> places,
                          const RunContext& context) {
    std::vector<Foot> feet(places.size());
    surface.find(
        places, [&](std::size_t i, const Foot& foot) { feet[i] = foot; }, context);
    return feet;
}

/// Whether projection brings the neighbours of a place back beside it.
bool is_on(const FootFinder& surface, const Vec3f& place, const RunContext& context) {
    const Foot own = feet_of(surface, {&place, 1}, context).front();
    const auto places = around(place, kBeside * own.h);
    return std::ranges::all_of(feet_of(surface, places, context), [&](const Foot& foot) {
        return foot.distance <= kGone * kBeside * own.h;
    });
}

/// No more than the distance of any place close by and the way to it.
double distance_of(const FootFinder& surface, const Vec3f& place, const RunContext& context) {
    const Foot foot = feet_of(surface, {&place, 1}, context).front();
    const auto places = around(place, kNear * foot.h);
    double least = foot.distance;
    for (const Foot& other : feet_of(surface, places, context))
        least = std::min(least, other.distance + kNear * foot.h);
    return least;
}

}  // namespace

void confirm_worst(std::span<Vec3f> places, std::span<double> distances, const FootFinder& surface,
                   const FootFinder* drawn_on, std::span<const Vec3f> points, const PointTree& tree,
                   const RunContext& context) {
    const std::size_t at_once = std::min(kMostAtOnce, places.size() / kOneOf);
    if (at_once == 0) return;
    auto order = made_in_blocks<std::vector<Index>>(places.size(), context);
    for_blocks_in_order(order.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) order[i] = static_cast<Index>(i);
    });
    double confirmed = 0;
    std::size_t first = 0;
    for (unsigned round = 0; round < kMostRounds; ++round) {
        const std::size_t last = std::min(first + at_once, order.size());
        const auto at = [&](std::size_t i) {
            return order.begin() + static_cast<std::ptrdiff_t>(i);
        };
        const auto farther = [&](Index a, Index b) {
            return distances[a] > distances[b] || (distances[a] == distances[b] && a < b);
        };
        std::partial_sort(at(first), at(last), order.end(), until_stopped(context, farther));
        for (; first < last; ++first) {
            context.throw_if_stopped();
            const Index i = order[first];
            if (distances[i] <= confirmed) return;
            if (drawn_on != nullptr && !is_on(*drawn_on, places[i], context)) {
                Neighbor nearest;
                find_nearest(tree, places[i], {&nearest, 1});
                places[i] = points[nearest.index];
            }
            distances[i] = distance_of(surface, places[i], context);
            confirmed = std::max(confirmed, distances[i]);
        }
    }
}

}  // namespace stipple
