#include "error_watch.hpp"

#include "parallel_for.hpp"
#include "tree_search.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace stipple {

namespace {

constexpr std::uint64_t kAroundSeed = 1, kUnevenSeed = 2, kCloserSeed = 3;
constexpr unsigned kAround = 8;   // places around each point of a candidate
constexpr unsigned kUneven = 56;  // more of them where its surface is uneven
constexpr unsigned kCloser = 4;   // around a suspicious place, in each round
constexpr unsigned kRounds = 3;
// Parts of what is too far that make a place suspicious. Places of the surface itself lie close
// together, so that only the worst can have a much worse one between.
constexpr double kSuspiciousFrom = 0.8, kSuspiciousBack = 0.5;

bool before(const Vec3f& a, const Vec3f& b) {
    return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end());
}

/// The numbers of points in the order of their coordinates.
std::vector<Index> sorted(std::span<const Vec3f> points) {
    std::vector<Index> order(points.size());
    std::iota(order.begin(), order.end(), Index{0});
    std::ranges::sort(order, before, [&](Index i) { return points[i]; });
    return order;
}

std::vector<Vec3f> at(std::span<const Vec3f> points, std::span<const Index> which) {
    std::vector<Vec3f> chosen(which.size());
    for (std::size_t i = 0; i < which.size(); ++i) chosen[i] = points[which[i]];
    return chosen;
}

}  // namespace

ErrorWatch::ErrorWatch(const ProbedSurface& surface, std::vector<Vec3f> places, double margin)
    : surface_(surface), margin_(margin), places_(std::move(places)), forward_(places_.size()) {}

void ErrorWatch::look_at(std::vector<Vec3f> points, const RunContext& context) {
    // What is known of points that stay is kept; those that came or went are the changes.
    const bool first = points_.empty();
    std::vector<Spot> spots(points.size());
    std::vector<Index> fresh;
    std::vector<Vec3f> changed;
    std::vector<Index> kept;
    const std::vector<Index> old_order = sorted(points_), new_order = sorted(points);
    auto old = old_order.begin();
    for (const Index i : new_order) {
        while (old != old_order.end() && before(points_[*old], points[i]))
            changed.push_back(points_[*old++]);
        if (old != old_order.end() && points_[*old] == points[i]) {
            spots[i] = backward_[*old++];
            kept.push_back(i);
        } else {
            changed.push_back(points[i]);
            fresh.push_back(i);
        }
    }
    for (; old != old_order.end(); ++old) changed.push_back(points_[*old]);
    points_ = std::move(points);
    backward_ = std::move(spots);
    if (changed.empty()) return;

    const ProbedSurface candidate(points_, context);
    std::vector<Index> from_places;
    if (first) {
        from_places.resize(places_.size());
        std::iota(from_places.begin(), from_places.end(), Index{0});
    } else {
        from_places = touched(places_, forward_, changed, context);
        std::ranges::sort(kept);
        std::vector<Spot> kept_spots(kept.size());
        for (std::size_t i = 0; i < kept.size(); ++i) kept_spots[i] = backward_[kept[i]];
        for (const Index i : touched(at(points_, kept), kept_spots, changed, context))
            fresh.push_back(kept[i]);
    }
    std::ranges::sort(fresh);  // in the order of the candidate: neighbours are near each other
    measure_from_surface(candidate, from_places, context);
    measure_from_candidate(candidate, fresh, context);
}

std::vector<Index> ErrorWatch::touched(std::span<const Vec3f> centers, std::span<const Spot> spots,
                                       std::span<const Vec3f> changed,
                                       const RunContext& context) const {
    const PointTree tree(changed, PointTree::Leaves::Quick, context);
    std::vector<std::uint8_t> is_touched(centers.size(), 0);
    parallel_for_blocks(centers.size(), 2048, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            Neighbor nearest;
            find_nearest(tree, centers[i], {&nearest, 1});
            const float reach = spots[i].reach;
            // What is too far is looked at again in any case: reaches are estimates.
            is_touched[i] =
                nearest.distance_sq <= reach * reach || spots[i].distance > margin_ ? 1 : 0;
        }
    });
    std::vector<Index> which;
    for (std::size_t i = 0; i < is_touched.size(); ++i)
        if (is_touched[i] != 0) which.push_back(static_cast<Index>(i));
    return which;
}

void ErrorWatch::measure_from_surface(const ProbedSurface& candidate, std::span<const Index> which,
                                      const RunContext& context) {
    const Probes probes = surface_.measure(at(places_, which), candidate, margin_, context);
    for (std::size_t i = 0; i < which.size(); ++i)
        forward_[which[i]] = {probes.places[i], probes.distances[i], probes.reach[i]};
    look_closer(surface_, candidate, which, forward_, kSuspiciousFrom, context);
}

void ErrorWatch::measure_from_candidate(const ProbedSurface& candidate,
                                        std::span<const Index> which, const RunContext& context) {
    const std::vector<Vec3f> centers = at(points_, which);
    PlacesAround around = candidate.places_around(centers, 1, kAround, kAroundSeed, context);
    for (std::size_t i = 0; i < which.size(); ++i)
        backward_[which[i]] = {centers[i], 0.0F, around.reach[i]};
    std::vector<Index> uneven;
    for (std::size_t i = 0; i < which.size(); ++i)
        if (around.uneven[i] != 0) uneven.push_back(which[i]);
    const auto keep_farthest = [&](const PlacesAround& found, std::span<const Index> of) {
        const Probes probes = candidate.measure(found.places, surface_, margin_, context);
        for (std::size_t i = 0; i < probes.places.size(); ++i) {
            Spot& spot = backward_[of[found.centers[i]]];
            if (probes.distances[i] <= spot.distance) continue;
            spot.distance = probes.distances[i];
            spot.farthest = probes.places[i];
        }
    };
    keep_farthest(around, which);
    around = candidate.places_around(at(points_, uneven), 1.2F, kUneven, kUnevenSeed, context);
    keep_farthest(around, uneven);
    for (std::size_t i = 0; i < uneven.size(); ++i) {
        float& reach = backward_[uneven[i]].reach;
        reach = std::max(reach, around.reach[i]);
    }
    look_closer(candidate, surface_, which, backward_, kSuspiciousBack, context);
}

/// Rounds of random places, nearer and nearer to the farthest found. What is too far already is
/// left alone.
void ErrorWatch::look_closer(const ProbedSurface& from, const ProbedSurface& to,
                             std::span<const Index> which, std::vector<Spot>& spots,
                             double suspicious, const RunContext& context) const {
    float spread = 1;
    for (unsigned round = 0; round < kRounds; ++round, spread /= 2) {
        std::vector<Index> chosen;
        std::vector<Vec3f> centers;
        for (const Index i : which) {
            if (spots[i].distance <= suspicious * margin_ || spots[i].distance > margin_) continue;
            chosen.push_back(i);
            centers.push_back(spots[i].farthest);
        }
        if (chosen.empty()) return;
        const PlacesAround around =
            from.places_around(centers, spread, kCloser, kCloserSeed + round, context);
        const Probes probes = from.measure(around.places, to, margin_, context);
        for (std::size_t i = 0; i < probes.places.size(); ++i) {
            Spot& spot = spots[chosen[around.centers[i]]];
            if (probes.distances[i] <= spot.distance) continue;
            spot.distance = probes.distances[i];
            spot.farthest = probes.places[i];
        }
    }
}

double ErrorWatch::max() const noexcept {
    float farthest = 0;
    for (const std::vector<Spot>* const spots : {&forward_, &backward_})
        for (const Spot& spot : *spots) farthest = std::max(farthest, spot.distance);
    return farthest;
}

std::vector<Vec3f> ErrorWatch::places_too_far() const {
    std::vector<Vec3f> places;
    for (const std::vector<Spot>* const spots : {&forward_, &backward_})
        for (const Spot& spot : *spots)
            if (spot.distance > margin_) places.push_back(spot.farthest);
    return places;
}

}  // namespace stipple
