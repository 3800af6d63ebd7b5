#include "surface_probe.hpp"

#include "error_samples.hpp"
#include "random.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace stipple {

namespace {

constexpr std::size_t kMostWorst = 4'096;  // places that are looked around at in a round
constexpr std::size_t kTriesAround = 8;    // of each
constexpr unsigned kRounds = 3;

/// A random place in the ball of radius 1.
Vec3f in_ball(std::uint64_t seed, std::uint64_t i) {
    for (std::uint64_t attempt = 0;; ++attempt) {
        Vec3f v;
        for (unsigned axis = 0; axis < 3; ++axis)
            v[axis] =
                static_cast<float>(random_bits(3 * attempt + axis + (seed << 32U), i) >> 40U) *
                    0x1p-23F -
                1;
        if (v.squaredNorm() <= 1) return v;
    }
}

/// The numbers of the probes above a distance, the farthest first where there are too many.
std::vector<Index> worst_of(const Probes& probes, double distance) {
    std::vector<Index> worst;
    for (std::size_t i = 0; i < probes.distances.size(); ++i)
        if (probes.distances[i] > distance) worst.push_back(static_cast<Index>(i));
    if (worst.size() > kMostWorst) {
        std::ranges::stable_sort(worst, std::greater(),
                                 [&](Index i) { return probes.distances[i]; });
        worst.resize(kMostWorst);
    }
    return worst;
}

}  // namespace

float Probes::max() const noexcept {
    return distances.empty() ? 0.0F : *std::ranges::max_element(distances);
}

std::vector<Vec3f> Probes::places_above(double bound) const {
    std::vector<Vec3f> above;
    for (std::size_t i = 0; i < distances.size(); ++i)
        if (distances[i] > bound) above.push_back(places[i]);
    return above;
}

ProbedSurface::ProbedSurface(std::vector<Vec3f> points, const RunContext& context)
    : points_(std::move(points)),
      tree_(points_, PointTree::Leaves::Compact, context),
      finder_(points_, tree_, {}) {}

std::vector<Vec3f> ProbedSurface::some_points(std::uint64_t count,
                                              const RunContext& context) const {
    return take_points(tree_, count, 0, context).positions;
}

std::vector<Vec3f> ProbedSurface::random_places(std::uint64_t count,
                                                const RunContext& context) const {
    return take_surface(tree_, finder_, count, 0, context).positions;
}

Probes ProbedSurface::measure(std::vector<Vec3f> places, const ProbedSurface& other,
                              const RunContext& context) const {
    Probes probes{std::move(places), {}};
    probes.distances.resize(probes.places.size());
    other.finder_.find(
        probes.places,
        [&](std::size_t i, const Foot& foot) {
            probes.distances[i] = static_cast<float>(foot.distance);
        },
        context);
    return probes;
}

std::vector<Vec3f> ProbedSurface::places_around(std::span<const Vec3f> centers, float reach,
                                                std::uint64_t seed,
                                                const RunContext& context) const {
    std::vector<float> scales(centers.size());
    finder_.find(
        centers, [&](std::size_t i, const Foot& foot) { scales[i] = static_cast<float>(foot.h); },
        context);
    std::vector<Vec3f> around(kTriesAround * centers.size());
    for (std::size_t i = 0; i < around.size(); ++i) {
        const std::size_t c = i / kTriesAround;
        around[i] = centers[c] + reach * scales[c] * in_ball(seed, i);
    }
    std::vector<std::uint8_t> on_surface(around.size(), 0);
    std::vector<Vec3f> feet(around.size());
    finder_.find(
        around,
        [&](std::size_t i, const Foot& foot) {
            on_surface[i] = foot.converged && !foot.beyond ? 1 : 0;
            feet[i] = foot.point.cast<float>();
        },
        context);
    std::vector<Vec3f> places;
    for (std::size_t i = 0; i < feet.size(); ++i)
        if (on_surface[i] != 0) places.push_back(feet[i]);
    return places;
}

void ProbedSurface::search_around(Probes& probes, const ProbedSurface& other, double distance,
                                  const RunContext& context) const {
    float reach = 1;  // of the scale of the weights
    for (unsigned round = 0; round < kRounds; ++round, reach /= 2) {
        const std::vector<Index> worst = worst_of(probes, distance);
        if (worst.empty()) return;
        std::vector<Vec3f> centers(worst.size());
        for (std::size_t i = 0; i < worst.size(); ++i) centers[i] = probes.places[worst[i]];
        const Probes more = measure(places_around(centers, reach, round, context), other, context);
        probes.places.insert(probes.places.end(), more.places.begin(), more.places.end());
        probes.distances.insert(probes.distances.end(), more.distances.begin(),
                                more.distances.end());
    }
}

}  // namespace stipple
