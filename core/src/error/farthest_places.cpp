#include "error/farthest_places.hpp"

#include "base/parallel_for.hpp"
#include "error/error_samples.hpp"
#include "error/foot_distance.hpp"
#include "error/worst_samples.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>

namespace stipple {

namespace {

constexpr std::size_t kBlock = std::size_t{1} << 14U;
constexpr std::size_t kOneOf = 8, kFewest = 4096;  // of those that are left, in each round
constexpr std::size_t kBeside = 2;                 // known points before and after one in the tree
constexpr std::size_t kFarthest = 64, kPointsOfEach = 4, kPlacesOfEach = 16;

double farthest(const MeasuredPlaces& measured) noexcept {
    return *std::ranges::max_element(measured.distances);
}

/// Those of some points, ascending, that may be farther than `max`, by the known ones before and
/// after them in the order of the tree.
template <typename PointAt>
std::vector<Index> which_may_be_farther(const PointTree& tree, std::size_t n,
                                        const PointAt& point_at,
                                        std::span<const KnownDistance> known, double max,
                                        const RunContext& context) {
    std::vector<std::vector<Index>> left((n + kBlock - 1) / kBlock);
    parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
        auto after = std::ranges::lower_bound(known, point_at(begin), {}, &KnownDistance::at);
        for (std::size_t i = begin; i < end; ++i) {
            const std::size_t at = point_at(i);
            while (after != known.end() && after->at < at) ++after;
            const auto first = after - std::min<std::ptrdiff_t>(kBeside, after - known.begin());
            const auto last = after + std::min<std::ptrdiff_t>(kBeside, known.end() - after);
            const Vec3f p = tree.position(at);
            const bool nearer = std::any_of(first, last, [&](const KnownDistance& other) {
                return other.distance + (p - tree.position(other.at)).norm() <= max;
            });
            if (!nearer) left[begin / kBlock].push_back(static_cast<Index>(at));
        }
    });
    std::vector<Index> all;
    for (const auto& some : left) all.insert(all.end(), some.begin(), some.end());
    return all;
}

/// Measures some points and adds them to what is known.
void measure_points(const LonePoints& all, const FootFinder& surface, std::span<const Index> points,
                    std::vector<KnownDistance>& known, MeasuredPlaces& measured,
                    const RunContext& context) {
    const PointTree& tree = all.tree();
    const std::size_t before = measured.places.size();
    for (const Index at : points) measured.places.push_back(tree.position(at));
    measured.distances.resize(measured.places.size());
    std::vector<KnownDistance> found(points.size());
    surface.find(
        std::span(measured.places).subspan(before),
        [&](std::size_t i, const Foot& foot) {
            double& distance = measured.distances[before + i];
            distance = distance_of(foot, all, measured.places[before + i]);
            found[i] = known_of(points[i], foot, distance);
        },
        context);
    const auto middle = static_cast<std::ptrdiff_t>(known.size());
    known.insert(known.end(), found.begin(), found.end());
    std::ranges::inplace_merge(known, known.begin() + middle, {}, &KnownDistance::at);
}

/// The places that are farthest, the farthest first.
std::vector<Vec3f> farthest_places(const MeasuredPlaces& measured, std::size_t count) {
    std::vector<std::size_t> order(measured.places.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    const auto last = order.begin() + static_cast<std::ptrdiff_t>(std::min(count, order.size()));
    std::ranges::partial_sort(order, last, [&](std::size_t a, std::size_t b) {
        const double p = measured.distances[a], q = measured.distances[b];
        return p > q || (p == q && a < b);
    });
    std::vector<Vec3f> places;
    for (auto i = order.begin(); i != last; ++i) places.push_back(measured.places[*i]);
    return places;
}

}  // namespace

KnownDistance known_of(std::size_t at, const Foot& foot, double distance) noexcept {
    constexpr double kEmpty = 0.5;
    const bool tells =
        distance == foot.distance && (foot.beyond || (foot.converged && foot.emptiness <= kEmpty));
    return {at, tells ? static_cast<float>(foot.distance) : std::numeric_limits<float>::infinity()};
}

void add_farthest_points(const LonePoints& points, const FootFinder& surface,
                         std::vector<KnownDistance> known, MeasuredPlaces& measured,
                         const RunContext& context) {
    const PointTree& tree = points.tree();
    std::vector<Index> left = which_may_be_farther(
        tree, tree.size(), [](std::size_t i) { return i; }, known, farthest(measured), context);
    std::vector<Index> chosen, others;
    while (!left.empty()) {
        const std::size_t step = std::clamp<std::size_t>(left.size() / kFewest, 1, kOneOf);
        chosen.clear();
        others.clear();
        for_blocks_in_order(left.size(), context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                (i % step == step / 2 ? chosen : others).push_back(left[i]);
        });
        measure_points(points, surface, chosen, known, measured, context);
        confirm_worst(measured.places, measured.distances, surface, nullptr, {}, tree, context);
        left = which_may_be_farther(
            tree, others.size(), [&](std::size_t i) { return others[i]; }, known,
            farthest(measured), context);
    }
}

namespace {

/// Sixteen places for each of the points around the farthest.
void add_places_once(const FootFinder& from, const LonePoints& points, const FootFinder& to,
                     std::uint64_t seed, MeasuredPlaces& measured, const RunContext& context) {
    std::vector<Index> near;
    std::array<Neighbor, kPointsOfEach> nearest;
    for (const Vec3f& place : farthest_places(measured, kFarthest))
        for (const Neighbor& neighbor : find_nearest(points.tree(), place, nearest))
            near.push_back(neighbor.index);
    std::ranges::sort(near);
    near.erase(std::ranges::unique(near).begin(), near.end());
    std::vector<Vec3f> bases;
    for (const Index point : near) bases.insert(bases.end(), kPlacesOfEach, from.points()[point]);

    const std::size_t before = measured.places.size();
    const std::vector<Vec3f> places = random_places(points, from, bases, seed, context).positions;
    measured.places.insert(measured.places.end(), places.begin(), places.end());
    measured.distances.resize(measured.places.size());
    to.find(
        places,
        [&](std::size_t i, const Foot& foot) {
            measured.distances[before + i] = distance_of(foot, points, places[i]);
        },
        context);
    confirm_worst(measured.places, measured.distances, to, &from, from.points(), points.tree(),
                  context);
}

}  // namespace

void add_places_around_farthest(const FootFinder& from, const LonePoints& points,
                                const FootFinder& to, MeasuredPlaces& measured,
                                const RunContext& context) {
    constexpr std::uint64_t kMostRounds = 8;
    constexpr double kGrowth = 1.02;  // less than that is the end
    for (std::uint64_t round = 1; round <= kMostRounds; ++round) {
        const double before = farthest(measured);
        add_places_once(from, points, to, round, measured, context);
        if (farthest(measured) <= kGrowth * before) break;
    }
}

}  // namespace stipple
