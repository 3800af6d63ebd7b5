#include "error/worst_samples.hpp"

#include "base/first_touch.hpp"
#include "base/until_stopped.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace stipple {

namespace {

constexpr std::size_t kAround = 14, kMostAtFirst = 32, kFirst = 500, kMost = 20, kFew = 2048;
constexpr double kBeside = 0.01;                // in h
constexpr std::array kNear = {0.05, 0.1, 0.2};  // in h
constexpr double kAsGood = 1.01;  // a distance by iteration changes by a little more than the way
constexpr double kGone = 5;       // times as far as the neighbour is

/// One of 14 places evenly around another: the corners and then the sides of a cube.
Vec3f beside(const Vec3f& place, double radius, std::size_t c) {
    const auto r = static_cast<float>(radius), step = static_cast<float>(radius / std::sqrt(3.0));
    constexpr std::size_t kCorners = 8;
    if (c < kCorners)
        return place + step * Vec3f(c & 1 ? 1.F : -1.F, c & 2 ? 1.F : -1.F, c & 4 ? 1.F : -1.F);
    const auto axis = static_cast<Eigen::Index>((c - kCorners) / 2);
    return place + (c & 1 ? r : -r) * Vec3f::Unit(axis);
}

std::vector<Foot> feet_of(const FootFinder& surface, std::span<const Vec3f> places,
                          const RunContext& context) {
    std::vector<Foot> feet(places.size());
    surface.find(
        places, [&](std::size_t i, const Foot& foot) { feet[i] = foot; }, context);
    return feet;
}

/// Whether projection brings what lies around a place back beside it.
std::vector<bool> are_on(const FootFinder& surface, std::span<const Vec3f> places,
                         const RunContext& context) {
    const std::vector<Foot> own = feet_of(surface, places, context);
    std::vector<Vec3f> around;
    for (std::size_t i = 0; i < places.size(); ++i)
        for (std::size_t c = 0; c < kAround; ++c)
            around.push_back(beside(places[i], kBeside * own[i].h, c));
    const std::vector<Foot> feet = feet_of(surface, around, context);
    std::vector<bool> on(places.size());
    for (std::size_t i = 0; i < places.size(); ++i) {
        const double most = kGone * kBeside * own[i].h;
        on[i] = std::ranges::all_of(std::span(feet).subspan(kAround * i, kAround),
                                    [&](const Foot& foot) { return foot.distance <= most; });
    }
    return on;
}

/// Moves those places that are not on the surface to the foot of the nearest point of the cloud;
/// where that is not on it either there is at least the point.
void move_to_surface(std::span<Vec3f> places, const FootFinder& surface,
                     std::span<const Vec3f> points, const PointTree& tree,
                     const RunContext& context) {
    const std::vector<bool> stay = are_on(surface, places, context);
    std::vector<std::size_t> moved;
    std::vector<Vec3f> nearest_points, feet;
    for (std::size_t i = 0; i < places.size(); ++i) {
        if (stay[i]) continue;
        Neighbor nearest;
        find_nearest(tree, places[i], {&nearest, 1});
        moved.push_back(i);
        nearest_points.push_back(points[nearest.index]);
    }
    for (const Foot& foot : feet_of(surface, nearest_points, context))
        feet.push_back(foot.point.cast<float>());
    const std::vector<bool> on = are_on(surface, feet, context);
    for (std::size_t i = 0; i < moved.size(); ++i)
        places[moved[i]] = on[i] ? feet[i] : nearest_points[i];
}

/// The distances of feet, none larger than the way to the nearest sample and from there to the
/// surface. A sample around which there is none stands for it.
std::vector<double> by_samples(const FootFinder& surface, std::span<const Vec3f> places,
                               std::span<const Foot> feet, const RunContext& context) {
    std::vector<std::size_t> farther;
    std::vector<Vec3f> samples;
    std::vector<double> distances(places.size());
    for (std::size_t i = 0; i < places.size(); ++i) {
        distances[i] = feet[i].distance;
        if (feet[i].distance <= feet[i].to_sample) continue;
        farther.push_back(i);
        samples.push_back(surface.nearest_sample(places[i]));
    }
    const std::vector<Foot> of_samples = feet_of(surface, samples, context);
    for (std::size_t j = 0; j < farther.size(); ++j) {
        const Foot& foot = of_samples[j];
        const double on = foot.on_surface() ? foot.distance : 0;
        double& distance = distances[farther[j]];
        distance = std::min(distance, feet[farther[j]].to_sample + on);
    }
    return distances;
}

}  // namespace

std::vector<double> confirmed_distances(const FootFinder& surface, std::span<const Vec3f> places,
                                        const RunContext& context) {
    const std::vector<Foot> own = feet_of(surface, places, context);
    std::vector<Vec3f> around;
    around.reserve(kNear.size() * kAround * places.size());
    for (std::size_t i = 0; i < places.size(); ++i)
        for (const double near : kNear)
            for (std::size_t c = 0; c < kAround; ++c)
                around.push_back(beside(places[i], near * own[i].h, c));
    const std::vector<Foot> feet = feet_of(surface, around, context);
    std::vector<double> distances = by_samples(surface, places, own, context);
    auto foot = feet.begin();
    for (std::size_t i = 0; i < places.size(); ++i) {
        const bool in_knot = !own[i].on_surface();  // others in it are then as good
        for (const double near : kNear)
            for (std::size_t c = 0; c < kAround; ++c, ++foot)
                if (foot->on_surface() || foot->beyond || (in_knot && foot->is_fixed()))
                    distances[i] = std::min(distances[i], foot->distance + near * own[i].h);
    }
    return distances;
}

void confirm_worst(std::span<Vec3f> places, std::span<double> distances, const FootFinder& surface,
                   const FootFinder* drawn_on, std::span<const Vec3f> points, const PointTree& tree,
                   const RunContext& context) {
    if (places.size() < kFew) return;
    std::size_t at_once = std::min(kMostAtFirst, places.size() / kFirst);
    auto order = made_in_blocks<std::vector<Index>>(places.size(), context);
    for_blocks_in_order(order.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) order[i] = static_cast<Index>(i);
    });
    std::vector<Vec3f> chosen;
    double confirmed = 0;
    for (std::size_t first = 0; first < places.size() / kMost; at_once *= 2) {
        const std::size_t last = std::min(first + at_once, order.size());
        const auto at = [&](std::size_t i) {
            return order.begin() + static_cast<std::ptrdiff_t>(i);
        };
        const auto farther = [&](Index a, Index b) {
            return distances[a] > distances[b] || (distances[a] == distances[b] && a < b);
        };
        std::partial_sort(at(first), at(last), order.end(), until_stopped(context, farther));
        if (distances[order[first]] <= kAsGood * confirmed) return;
        chosen.clear();
        for (std::size_t i = first; i < last; ++i) chosen.push_back(places[order[i]]);
        if (drawn_on != nullptr) move_to_surface(chosen, *drawn_on, points, tree, context);
        const std::vector<double> again = confirmed_distances(surface, chosen, context);
        for (std::size_t i = first; i < last; ++i) {
            // A point that lies alone may be known to be nearer than its foot.
            const bool stays = places[order[i]] == chosen[i - first];
            double& distance = distances[order[i]];
            distance = stays ? std::min(distance, again[i - first]) : again[i - first];
            places[order[i]] = chosen[i - first];
            confirmed = std::max(confirmed, distance);
        }
        first = last;
    }
}

}  // namespace stipple
