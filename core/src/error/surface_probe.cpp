#include "error/surface_probe.hpp"

#include "base/parallel_for.hpp"
#include "base/random.hpp"
#include "error/error_samples.hpp"
#include "error/worst_samples.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

namespace stipple {

namespace {

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

/// A number that stands for a place.
std::uint64_t name_of(const Vec3f& place) {
    std::uint64_t name = 0;
    for (const float x : {place.x(), place.y(), place.z()})
        name = random_bits(name, std::bit_cast<std::uint32_t>(x));
    return name;
}

/// Whether a foot is not in the middle of an even piece of surface.
bool is_uneven(const Foot& foot) {
    return !foot.on_surface() || foot.is_one_sided();
}

/// How far from a query points have a say in its foot: as far as the neighbourhood of the foot
/// reaches, and a little for those on the way.
float reach_of(const Vec3f& query, const Foot& foot) {
    constexpr double kFurther = 1.2;
    if (foot.h == 0) return std::numeric_limits<float>::infinity();
    const double away = (query.cast<double>() - foot.point).norm();
    return static_cast<float>(kFurther * (away + foot.radius));
}

}  // namespace

float Probes::max() const noexcept {
    return distances.empty() ? 0.0F : *std::ranges::max_element(distances);
}

Vec3f Probes::farthest() const noexcept {
    return places[static_cast<std::size_t>(std::ranges::max_element(distances) -
                                           distances.begin())];
}

std::vector<Vec3f> Probes::places_above(double bound) const {
    std::vector<Vec3f> above;
    for (std::size_t i = 0; i < distances.size(); ++i)
        if (distances[i] > bound) above.push_back(places[i]);
    return above;
}

ProbedSurface::ProbedSurface(std::vector<Vec3f> points, Reading reading, const RunContext& context)
    : points_(std::move(points)),
      reading_(reading),
      tree_(points_, PointTree::Leaves::Compact, context),
      finder_(points_, tree_, {}),
      lone_points_(points_, tree_) {}

std::vector<Vec3f> ProbedSurface::some_points(std::uint64_t count,
                                              const RunContext& context) const {
    return take_points(lone_points_, count, 0, context).positions;
}

std::vector<Vec3f> ProbedSurface::random_places(std::uint64_t count,
                                                const RunContext& context) const {
    return take_surface(lone_points_, finder_, count, 0, context).positions;
}

Probes ProbedSurface::measure(std::vector<Vec3f> places, const ProbedSurface& other,
                              double doubtful, const RunContext& context) const {
    Probes probes;
    probes.places = std::move(places);
    probes.distances.resize(probes.places.size());
    probes.reach.resize(probes.places.size());
    probes.uneven.resize(probes.places.size());
    std::vector<float> overhangs(probes.places.size());
    other.finder_.find(
        probes.places,
        [&](std::size_t i, const Foot& foot) {
            FootFinder::Overhang overhang = other.finder_.overhang_of(probes.places[i], foot);
            if (overhang.way > 0)
                overhang =
                    other.finder_.overhang_of(probes.places[i], foot, FootFinder::kMostAround);
            overhangs[i] = overhang.way;
            probes.distances[i] = std::max(static_cast<float>(foot.distance), overhang.way);
            probes.reach[i] = std::max(reach_of(probes.places[i], foot), overhang.reach);
            probes.uneven[i] = is_uneven(foot) ? 1 : 0;
        },
        context);
    if (reading_ == Reading::ByTheLetter || other.reading_ == Reading::ByTheLetter) return probes;
    std::vector<std::size_t> which;
    std::vector<Vec3f> again;
    for (std::size_t i = 0; i < probes.places.size(); ++i) {
        if (probes.distances[i] <= doubtful) continue;
        which.push_back(i);
        again.push_back(probes.places[i]);
    }
    constexpr std::size_t kFew = 300, kPart = 20;  // more are too far, whatever is between them
    if (which.size() > std::max(kFew, probes.places.size() / kPart)) return probes;
    const std::vector<double> confirmed = confirmed_distances(other.finder_, again, context);
    for (std::size_t i = 0; i < which.size(); ++i)
        probes.distances[which[i]] =
            std::max(static_cast<float>(confirmed[i]), overhangs[which[i]]);
    return probes;
}

float ProbedSurface::to_point(const Vec3f& place) const {
    return (finder_.nearest_sample(place) - place).norm();
}

bool ProbedSurface::is_beyond_border(const Foot& foot) const {
    if (!foot.is_one_sided()) return false;
    const Vec3f place = foot.point.cast<float>();
    std::array<Neighbor, 1> room;
    const Neighbor nearest = find_nearest(tree_, place, room).front();
    constexpr std::size_t kThird = 3;
    std::array<Neighbor, kThird + 1> around;  // and the point itself
    const float spacing_sq = find_nearest(tree_, points_[nearest.index], around).back().distance_sq;
    return nearest.distance_sq > kPlaceReach * kPlaceReach * spacing_sq;
}

PlacesAround ProbedSurface::places_around(std::span<const Vec3f> centers, float spread,
                                          unsigned each, std::uint64_t seed,
                                          const RunContext& context) const {
    const std::size_t n = centers.size();
    PlacesAround around;
    around.reach.resize(n);
    around.uneven.assign(n, 0);
    std::vector<float> scales(n);
    std::vector<Vec3f> normals(n);
    finder_.find(
        centers,
        [&](std::size_t c, const Foot& foot) {
            const auto radius = static_cast<float>(foot.radius);
            scales[c] = lone_points_.holds(centers[c], radius) ? 0.0F : static_cast<float>(foot.h);
            normals[c] = foot.normal.cast<float>();
            around.reach[c] = reach_of(centers[c], foot);
        },
        context);
    std::vector<Vec3f> near(each * n);
    constexpr std::size_t kBlock = 1'024;
    parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t c = begin; c < end; ++c) {
            const std::uint64_t name = name_of(centers[c]);
            for (unsigned j = 0; j < each; ++j)
                near[each * c + j] = centers[c] + spread * scales[c] * in_ball(seed, name + j);
        }
    });
    struct Found {
        Vec3f place;
        float reach;
        bool counts, uneven;
    };
    std::vector<Found> found(near.size());
    finder_.find(
        near,
        [&](std::size_t i, const Foot& foot) {
            constexpr float kTurned = 0.77F;  // cos 40 degrees
            const std::size_t c = i / each;
            const Vec3f place = foot.point.cast<float>();
            const FootFinder::Overhang overhang = finder_.overhang_of(place, foot);
            found[i] = {.place = place,
                        .reach = (near[i] - centers[c]).norm() +
                                 std::max(reach_of(near[i], foot), overhang.reach),
                        .counts = scales[c] > 0 &&
                                  (reading_ == Reading::ByTheLetter ? foot.is_fixed()
                                                                    : foot.on_surface()) &&
                                  overhang.way == 0 && !is_beyond_border(foot),
                        .uneven = is_uneven(foot) ||
                                  std::abs(foot.normal.cast<float>().dot(normals[c])) < kTurned};
        },
        context);
    std::size_t last_alone = n;
    for (std::size_t i = 0; i < found.size(); ++i) {
        const std::size_t c = i / each;
        around.reach[c] = std::max(around.reach[c], found[i].reach);
        if (found[i].uneven) around.uneven[c] = 1;
        // Where the surface is not to be found there is at least the center.
        if (!found[i].counts && std::exchange(last_alone, c) == c) continue;
        around.places.push_back(found[i].counts ? found[i].place : centers[c]);
        around.centers.push_back(static_cast<Index>(c));
    }
    return around;
}

}  // namespace stipple
