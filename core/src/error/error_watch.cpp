#include "error/error_watch.hpp"

#include "base/parallel_for.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

namespace stipple {

namespace {

constexpr std::uint64_t kAroundSeed = 1, kUnevenSeed = 2, kCloserSeed = 3, kSomeSeed = 10,
                        kAgainSeed = 100;
constexpr unsigned kAround = 8;                 // places around each point of a candidate
constexpr unsigned kUnevenBack = 160;           // more of them where its surface is uneven
constexpr std::size_t kMostUneven = 1'000'000;  // of both, where most of a surface is uneven
constexpr unsigned kSomeOf = 10;  // of these are looked at first: mostly they tell what is too far
constexpr unsigned kUnevenFrom = 12;       // around a place of the surface where the candidate's is
constexpr std::size_t kDense = 1'000'000;  // places of the surface, with no worse ones between
constexpr float kUnevenSpread = 1.2F;
constexpr std::uint64_t kMostAgain = 1'000;  // around one that is looked at again
constexpr unsigned kCloser = 4;              // around a suspicious place, in each round
constexpr unsigned kRounds = 3;
// Parts of what is too far that make a place suspicious. Places of the surface itself lie close
// together, so that only the worst can have a much worse one between.
constexpr double kSuspiciousFrom = 0.7, kSuspiciousBack = 0.5;

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

ErrorWatch::ErrorWatch(const ProbedSurface& surface, std::vector<Vec3f> places,
                       std::vector<Vec3f> off_surface, double margin, Reading reading)
    : surface_(surface),
      off_surface_(std::move(off_surface)),
      margin_(margin),
      reading_(reading),
      places_(std::move(places)),
      forward_(places_.size()) {
    std::ranges::sort(off_surface_, before);
}

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

    const ProbedSurface candidate(points_, reading_, context);
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
    look_closer(candidate, context);
}

std::vector<Index> ErrorWatch::touched(std::span<const Vec3f> centers, std::span<const Spot> spots,
                                       std::span<const Vec3f> changed,
                                       const RunContext& context) const {
    const PointTree tree(changed, PointTree::Leaves::Quick, context);
    std::vector<std::uint8_t> is_touched(centers.size(), 0);
    parallel_for_blocks(centers.size(), 2048, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const float reach = spots[i].reach;
            // What is too far is looked at again in any case: reaches are estimates.
            const bool again =
                spots[i].distance > margin_ || any_within(tree, centers[i], reach * reach);
            is_touched[i] = again ? 1 : 0;
        }
    });
    std::vector<Index> which;
    for (std::size_t i = 0; i < is_touched.size(); ++i)
        if (is_touched[i] != 0) which.push_back(static_cast<Index>(i));
    return which;
}

void ErrorWatch::measure_from_surface(const ProbedSurface& candidate, std::span<const Index> which,
                                      const RunContext& context) {
    looks_ += which.size();
    const Probes probes = surface_.measure(at(places_, which), candidate, margin_, context);
    for (std::size_t i = 0; i < which.size(); ++i)
        forward_[which[i]] = {.farthest = probes.places[i],
                              .distance = probes.distances[i],
                              .reach = probes.reach[i],
                              .uneven = probes.uneven[i] != 0};
}

void ErrorWatch::measure_from_candidate(const ProbedSurface& candidate,
                                        std::span<const Index> which, const RunContext& context) {
    const std::vector<Vec3f> centers = at(points_, which);
    for (std::size_t i = 0; i < which.size(); ++i) backward_[which[i]] = {.farthest = centers[i]};
    const std::vector<std::uint8_t> uneven =
        look_around(candidate, surface_, which, centers, backward_,
                    {.spread = 1, .each = kAround, .seed = kAroundSeed}, context);
    for (std::size_t i = 0; i < which.size(); ++i) backward_[which[i]].uneven = uneven[i] != 0;
}

std::vector<std::uint8_t> ErrorWatch::look_around(const ProbedSurface& from,
                                                  const ProbedSurface& to,
                                                  std::span<const Index> which,
                                                  std::span<const Vec3f> centers,
                                                  std::vector<Spot>& spots, const Look& look,
                                                  const RunContext& context) {
    looks_ += std::uint64_t{look.each} * centers.size();
    PlacesAround around = from.places_around(centers, look.spread, look.each, look.seed, context);
    const Probes probes = from.measure(std::move(around.places), to, margin_, context);
    // The candidate decides where the places are, or how far they are from it.
    const bool from_candidate = &from != &surface_;
    const auto extend = [&](Index i, const Vec3f& place, float reach) {
        spots[i].reach = std::max(spots[i].reach, (place - middles(spots)[i]).norm() + reach);
    };
    for (std::size_t c = 0; from_candidate && c < which.size(); ++c)
        extend(which[c], centers[c], around.reach[c]);
    for (std::size_t i = 0; i < probes.places.size(); ++i) {
        const Index center = which[around.centers[i]];
        if (!from_candidate) extend(center, probes.places[i], probes.reach[i]);
        if (probes.distances[i] <= spots[center].distance) continue;
        if (from_candidate && std::ranges::binary_search(off_surface_, probes.places[i], before))
            continue;  // a point of the input, however fine the candidate
        spots[center].distance = probes.distances[i];
        spots[center].farthest = probes.places[i];
    }
    return around.uneven;
}

void ErrorWatch::look_closer(const ProbedSurface& candidate, const RunContext& context) {
    const unsigned uneven_from = places_.size() < kDense ? kUnevenFrom : 0;
    for (const Closeness closeness : {Closeness::Some, Closeness::All}) {
        if (max() > margin_) return;
        look_closer(surface_, candidate, forward_, {uneven_from, kSuspiciousFrom}, closeness,
                    context);
        if (max() > margin_) return;
        look_closer(candidate, surface_, backward_, {kUnevenBack, kSuspiciousBack}, closeness,
                    context);
    }
}

/// At more places where the surface is uneven; then in rounds of random places, nearer and nearer
/// to the farthest found. What is too far already is left alone.
void ErrorWatch::look_closer(const ProbedSurface& from, const ProbedSurface& to,
                             std::vector<Spot>& spots, const Care& care, Closeness closeness,
                             const RunContext& context) {
    const bool all = closeness == Closeness::All;
    std::vector<Index> open, uneven;
    std::vector<Vec3f> centers;
    for (std::size_t i = 0; i < spots.size(); ++i) {
        if (spots[i].looked >= closeness) continue;
        spots[i].looked = closeness;
        open.push_back(static_cast<Index>(i));
        if (!spots[i].uneven || care.uneven == 0) continue;
        uneven.push_back(static_cast<Index>(i));
        centers.push_back(middles(spots)[i]);
    }
    const std::size_t most = kMostUneven / std::max<std::size_t>(1, uneven.size());
    const auto each = static_cast<unsigned>(std::clamp<std::size_t>(most, kCloser, care.uneven));
    look_around(from, to, uneven, centers, spots,
                {.spread = kUnevenSpread,
                 .each = all ? each : std::max(1U, each / kSomeOf),
                 .seed = all ? kUnevenSeed : kSomeSeed},
                context);
    if (!all) return;
    float spread = 1;
    for (unsigned round = 0; round < kRounds; ++round, spread /= 2) {
        std::erase_if(open, [&](Index i) {
            const double distance = spots[i].distance;
            return distance <= care.suspicious * margin_ || distance > margin_;
        });
        centers.clear();
        for (const Index i : open) centers.push_back(spots[i].farthest);
        look_around(from, to, open, centers, spots,
                    {.spread = spread, .each = kCloser, .seed = kCloserSeed + round}, context);
    }
}

void ErrorWatch::look_again(std::uint64_t places, std::uint64_t seed, const RunContext& context) {
    const ProbedSurface candidate(points_, reading_, context);
    for (std::vector<Spot>* const spots : {&forward_, &backward_}) {
        std::vector<Index> uneven;
        for (std::size_t i = 0; i < spots->size(); ++i)
            if ((*spots)[i].uneven) uneven.push_back(static_cast<Index>(i));
        if (uneven.empty()) continue;
        const std::uint64_t each = places / 2 / uneven.size();
        const bool forward = spots == &forward_;
        look_around(forward ? surface_ : candidate, forward ? candidate : surface_, uneven,
                    at(middles(*spots), uneven), *spots,
                    {.spread = kUnevenSpread,
                     .each = static_cast<unsigned>(std::clamp<std::uint64_t>(each, 1, kMostAgain)),
                     .seed = kAgainSeed + seed},
                    context);
    }
}

double ErrorWatch::max() const noexcept {
    float farthest = 0;
    for (const std::vector<Spot>* const spots : {&forward_, &backward_})
        for (const Spot& spot : *spots) farthest = std::max(farthest, spot.distance);
    return farthest;
}

Vec3f ErrorWatch::farthest_place() const noexcept {
    const Spot* farthest = &forward_.front();
    for (const std::vector<Spot>* const spots : {&forward_, &backward_})
        for (const Spot& spot : *spots)
            if (spot.distance > farthest->distance) farthest = &spot;
    return farthest->farthest;
}

std::vector<Vec3f> ErrorWatch::places_too_far() const {
    std::vector<Vec3f> places;
    for (const std::vector<Spot>* const spots : {&forward_, &backward_})
        for (const Spot& spot : *spots)
            if (spot.distance > margin_) places.push_back(spot.farthest);
    return places;
}

}  // namespace stipple
