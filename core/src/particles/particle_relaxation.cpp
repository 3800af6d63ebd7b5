#include "particles/particle_relaxation.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/until_stopped.hpp"
#include "cloud/float4.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <numeric>
#include <utility>

// Follows: Pauly, Gross, Kobbelt 2002, §3.3; Turk 1992 (the force); Witkin and Heckbert 1994 (a
// radius that follows what the particles find). Departures, all measured on scans:
// - The force is Turk's, (r - |p - p_i|) along p - p_i. Eq. 7 as it is printed does not divide the
//   factor p - p_i by its length, which makes it weaker the closer two particles are: pairs merge.
// - Pairs that are too close (radii below the spacing) push along the surface with the whole force.
//   Two particles on either side of a thin sheet would press each other into it and hardly part.
//   Not sooner: it drives particles away from creases, which costs 1.5 % of mean error.
// - A step keeps a part of the one before. Half as many are needed.
// - Neighbours are looked up once for several steps.

namespace stipple {

namespace {

constexpr std::size_t kBlock = 512;
constexpr float kForce = 0.35F;       // k of Eq. 7: a step over the sum of overlaps
constexpr float kMomentum = 0.6F;     // part of a step that the next one keeps
constexpr float kLongestStep = 0.5F;  // over the spacing
constexpr float kResting = 1e-4F;     // shorter steps, over the spacing, are not taken
constexpr float kCrowded = 0.05F;     // overlap over the radius
constexpr double kStrangers = 0.1;    // part of the particles that may lack new neighbours,
constexpr unsigned kOldest = 6;       // and for so many steps
constexpr std::size_t kRing = 6;      // neighbours of a particle on a surface
/// Within reach there are about ten; many more where what was spread over areas lies on a line.
constexpr std::size_t kMostNeighbors = 64;

/// The force turned into the plane across `normal`, as long as before; where it is all across, any
/// direction, and the opposite one for the other particle of the pair.
Vec3f along_plane(const Vec3f& force, float length, const Vec3f& normal, bool is_first) {
    const Vec3f along = force - normal * normal.dot(force);
    const float along_length = along.norm();
    constexpr float kAcross = 1e-3F;
    if (along_length > kAcross * length) return along * (length / along_length);
    return normal.unitOrthogonal() * (is_first ? length : -length);
}

/// Four neighbours of a particle, or those that are left; itself in place of what is missing.
struct FourOthers {
    std::array<Index, 4> particles;
    std::size_t count;

    FourOthers(std::span<const Index> near, std::size_t first, std::size_t i)
        : count(std::min<std::size_t>(4, near.size() - first)) {
        particles.fill(static_cast<Index>(i));
        std::copy_n(&near[first], count, particles.begin());
    }
};

/// A particle and four others: each lane is of one of them.
struct FourPairs {
    Float4 x, y, z;  ///< from the other to the particle
    Float4 radius, distance;
    Float4 overlap;  ///< of the radius over the distance; none where it is not above 0

    /// @param half  of the repulsion radius, over what `places` have as spacing.
    FourPairs(std::span<const std::array<float, 4>> places, std::size_t i,
              const std::array<Index, 4>& others, float half) {
        const Float4 own = load(places[i].data()), a = load(places[others[0]].data()),
                     b = load(places[others[1]].data()), c = load(places[others[2]].data()),
                     d = load(places[others[3]].data());
        const Float4 ab = __builtin_shufflevector(a, b, 0, 4, 1, 5),
                     cd = __builtin_shufflevector(c, d, 0, 4, 1, 5);
        x = own[0] - __builtin_shufflevector(ab, cd, 0, 1, 4, 5);
        y = own[1] - __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
        const Float4 ab_rest = __builtin_shufflevector(a, b, 2, 6, 3, 7),
                     cd_rest = __builtin_shufflevector(c, d, 2, 6, 3, 7);
        z = own[2] - __builtin_shufflevector(ab_rest, cd_rest, 0, 1, 4, 5);
        radius = half * (own[3] + __builtin_shufflevector(ab_rest, cd_rest, 2, 3, 6, 7));
        distance = square_root(x * x + (y * y + z * z));
        overlap = radius - distance;
    }
};

}  // namespace

ParticleRelaxation::ParticleRelaxation(const ParticleSurface& surface, std::vector<float> spacing,
                                       SpreadParticles start, const RunContext& context)
    : surface_(surface),
      context_(context.quietly()),
      spacing_(std::move(spacing)),
      positions_(std::move(start.positions)) {
    feet_.reserve(positions_.size());
    for (const Index sample : start.samples) feet_.push_back({.sample = sample});
    resize(positions_.size());
    update_places();
}

void ParticleRelaxation::resize(std::size_t count) {
    resize_in_blocks(next_, count, context_);
    steps_.clear();
    resize_in_blocks(steps_, count, context_);
    parallel_for_blocks(count, kBlock, context_, [&](std::size_t begin, std::size_t end) {
        std::fill(&steps_[begin], &steps_[begin] + (end - begin), Vec3f::Zero());
    });
    resize_in_blocks(places_, count, context_);
    moved_.assign(count, 1);
    moves_.resize(count);
    neighborhoods_.resize((count + kBlock - 1) / kBlock);
    progress_.resize(neighborhoods_.size());
    found_at_.clear();
}

std::vector<ParticleRelaxation::Place> ParticleRelaxation::places_between(float least_room) const {
    std::vector<std::vector<Place>> blocks(neighborhoods_.size());
    const auto add = [&](Index i, Index j, std::vector<Place>& places) {
        const std::span<const Index> near = neighborhoods_[i / kBlock].of(i % kBlock);
        const Vec3f middle = 0.5F * (positions_[i] + positions_[j]);
        const float radius_sq = (positions_[i] - middle).squaredNorm();
        const float room = 4 * std::sqrt(radius_sq) / (spacing(i) + spacing(j));
        if (room < least_room) return;
        if (std::ranges::any_of(near, [&](Index other) {
                return other != j && (positions_[other] - middle).squaredNorm() < radius_sq;
            }))
            return;
        Place place = {room, i, j, {}, feet_[i]};
        place.position = surface_.project(positions_[i], middle, place.foot);
        constexpr float kAstraySq = 0.25F;  // across a hole, or a thin sheet
        if ((place.position - middle).squaredNorm() < kAstraySq * radius_sq)
            places.push_back(place);
    };
    parallel_for_blocks(positions_.size(), kBlock, context_,
                        [&](std::size_t begin, std::size_t end) {
                            for (std::size_t i = begin; i < end; ++i) {
                                for (const Index j : neighborhoods_[i / kBlock].of(i % kBlock))
                                    if (j > i) add(static_cast<Index>(i), j, blocks[i / kBlock]);
                            }
                        });
    std::size_t count = 0;
    for (const std::vector<Place>& block : blocks) count += block.size();
    std::vector<Place> places;
    places.reserve(count);
    for (std::vector<Place>& block : blocks) {
        context_.throw_if_stopped();
        places.insert(places.end(), block.begin(), block.end());
        std::vector<Place>().swap(block);
    }
    return places;
}

/// Keeps those with the most room, in order.
template <typename Place>
void keep_widest(std::vector<Place>& places, std::size_t count, const RunContext& context) {
    const auto order = [](const Place& p) { return std::pair(p.i, p.j); };
    const auto wider = [&](const Place& a, const Place& b) {
        return a.room > b.room || (a.room == b.room && order(a) < order(b));
    };
    if (count < places.size()) {
        std::nth_element(places.begin(), places.begin() + static_cast<std::ptrdiff_t>(count),
                         places.end(), until_stopped(context, wider));
        places.resize(count);
    }
    std::ranges::sort(places, until_stopped(context, std::less<>()), order);
}

/// Particles at the places, each behind the first of its neighbours, without those that leave.
void ParticleRelaxation::insert(std::vector<Place> places,
                                const std::vector<std::uint8_t>& leaving) {
    std::vector<Vec3f> positions;
    std::vector<ParticleSurface::Foot> feet;
    positions.reserve(positions_.size() + places.size());
    feet.reserve(positions_.size() + places.size());
    auto place = places.begin();
    for (std::size_t i = 0; i < positions_.size(); ++i) {
        if (i % kBlock == 0) context_.throw_if_stopped();
        if (leaving.empty() || leaving[i] == 0) {
            positions.push_back(positions_[i]);
            feet.push_back(feet_[i]);
        }
        for (; place != places.end() && place->i == i; ++place) {
            positions.push_back(settled_ ? surface_.settle(place->position, place->foot, spacing(i))
                                         : place->position);
            feet.push_back(place->foot);
        }
    }
    positions_ = std::move(positions);
    feet_ = std::move(feet);
    resize(positions_.size());
    update_places();
}

bool ParticleRelaxation::split(std::size_t most) {
    find_neighbors();
    std::vector<Place> places = places_between(0);
    const std::size_t before = positions_.size(), wanted = most - before;
    if (2 * places.size() < std::min(before, wanted)) return false;
    keep_widest(places, wanted, context_);
    insert(std::move(places), {});
    factor_ *= std::sqrt(static_cast<float>(before) / static_cast<float>(positions_.size()));
    return true;
}

bool ParticleRelaxation::relocate(float radius) {
    constexpr float kRoomy = 1.3F;  // twice the distance to others at a place, over their spacing
    find_neighbors();
    std::vector<std::uint8_t> leaving(positions_.size());
    std::vector<Place> places = places_between(kRoomy);
    std::size_t count = 0;
    for (std::size_t i = 0; i < positions_.size() && count < places.size(); ++i) {
        if (i % kBlock == 0) context_.throw_if_stopped();
        for (const Index j : neighborhoods_[i / kBlock].of(i % kBlock)) {
            const float limit = (1 - kCrowded) * radius * 0.5F * (spacing(i) + spacing(j));
            if (leaving[i] != 0 || leaving[j] != 0) continue;
            leaving[i] = (positions_[i] - positions_[j]).squaredNorm() < limit * limit;
            count += leaving[i];
        }
    }
    if (count == 0) return false;
    keep_widest(places, count, context_);
    insert(std::move(places), leaving);
    return true;
}

ParticleRelaxation::Progress ParticleRelaxation::step(float radius, bool find_spacing) {
    if (radius != std::exchange(radius_, radius)) std::ranges::fill(moved_, std::uint8_t{1});
    const auto count = static_cast<double>(positions_.size());
    const bool many = static_cast<double>(strangers_) > kStrangers * count;
    if (found_at_.empty() || many || (strangers_ > 0 && age_ >= kOldest)) {
        find_neighbors();
        if (find_spacing) factor_ *= static_cast<float>(mean_ring());
    }
    ++age_;
    parallel_for_blocks(positions_.size(), kBlock, context_,
                        [&](std::size_t begin, std::size_t end) {
                            progress_[begin / kBlock] = move(begin, end, radius);
                        });
    std::swap(positions_, next_);
    std::swap(moved_, moves_);
    update_places();
    Progress result;
    strangers_ = 0;
    for (const BlockProgress& block : progress_) {
        result.mean_step += block.step_sum / count;
        result.crowded += block.crowded;
        strangers_ += block.strangers;
    }
    result.knows_all = strangers_ == 0;
    return result;
}

void ParticleRelaxation::update_places() {
    parallel_for_blocks(places_.size(), kBlock, context_, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const Vec3f& p = positions_[i];
            places_[i] = {p.x(), p.y(), p.z(), spacing_[feet_[i].sample]};
        }
    });
}

void ParticleRelaxation::settle() {
    settled_ = true;
    parallel_for_blocks(
        positions_.size(), kBlock, context_, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                positions_[i] = surface_.settle(positions_[i], feet_[i], spacing(i));
                steps_[i].setZero();
            }
        });
    update_places();
    found_at_.clear();
}

void ParticleRelaxation::find_neighbors() {
    age_ = 0;
    resize_in_blocks(found_at_, positions_.size(), context_);
    auto reach = made_in_blocks<std::vector<float>>(positions_.size(), context_);
    parallel_for_blocks(reach.size(), kBlock, context_, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            found_at_[i] = positions_[i];
            moved_[i] = 1;
            reach[i] = kReach * spacing(i);
        }
    });
    const ParticleTree tree(positions_, reach, context_);
    parallel_for_blocks(
        positions_.size(), kBlock, context_, [&](std::size_t begin, std::size_t end) {
            tree.find_neighbors(begin, end, neighborhoods_[begin / kBlock], kMostNeighbors);
        });
}

/// The mean distance of particles, over the spacing, to the six nearest; those that are out of
/// reach count as if they were just there. Of every so many-th particle of very many: of fewer than
/// here it may waver, by which they would seem to come no nearer to rest.
double ParticleRelaxation::mean_ring() const {
    constexpr std::size_t kAsked = 65'536;
    const std::size_t stride = (positions_.size() + kAsked - 1) / kAsked;
    std::vector<double> sums(neighborhoods_.size());
    parallel_for_blocks(positions_.size(), kBlock, context_,
                        [&](std::size_t begin, std::size_t end) {
                            const std::size_t first = (begin + stride - 1) / stride * stride;
                            for (std::size_t i = first; i < end; i += stride)
                                sums[begin / kBlock] += static_cast<double>(mean_of_ring(i));
                        });
    const std::size_t count = (positions_.size() + stride - 1) / stride;
    return std::accumulate(sums.begin(), sums.end(), 0.0) / static_cast<double>(count);
}

float ParticleRelaxation::mean_of_ring(std::size_t i) const {
    const std::span<const Index> near = neighborhoods_[i / kBlock].of(i % kBlock);
    std::array<float, kRing> nearest;  // ascending
    nearest.fill(kReach);
    for (std::size_t first = 0; first < near.size(); first += 4) {
        const FourOthers others(near, first, i);
        const FourPairs pairs(places_, i, others.particles, 0.5F * factor_);
        const Float4 distances = pairs.distance / pairs.radius;
        for (std::size_t lane = 0; lane < others.count; ++lane) {
            float distance = distances[lane];
            for (float& place : nearest) {  // no branch, which none could foretell
                const float nearer = std::min(place, distance);
                distance = std::max(place, distance);
                place = nearer;
            }
        }
    }
    return std::accumulate(nearest.begin(), nearest.end(), 0.0F) / kRing;
}

/// The total force (Eq. 8) on particle i, of `repulsion` by four others at once, or one by one
/// where it has to be turned.
Vec3f ParticleRelaxation::force_on(std::size_t i, float radius, bool& is_crowded) const {
    const std::span<const Index> near = neighborhoods_[i / kBlock].of(i % kBlock);
    const float half = 0.5F * radius * factor_;
    Float4 x{}, y{}, z{};
    Vec3f along = Vec3f::Zero();
    for (std::size_t first = 0; first < near.size(); first += 4) {
        const FourOthers others(near, first, i);
        const FourPairs pairs(places_, i, others.particles, half);
        const unsigned felt = lane_bits(pairs.overlap > Float4{}) & ((1U << others.count) - 1U);
        if (felt == 0) continue;
        is_crowded |= (felt & lane_bits(pairs.overlap > kCrowded * pairs.radius)) != 0;
        if (radius >= 1 && (felt & lane_bits(pairs.distance == Float4{})) == 0) {
            // Nothing by what is missing: the particle itself has no distance.
            const Float4 by = (pairs.overlap > Float4{}) & (pairs.distance > Float4{})
                                  ? pairs.overlap / pairs.distance
                                  : Float4{};
            x += pairs.x * by;
            y += pairs.y * by;
            z += pairs.z * by;
            continue;
        }
        const Vec3f normal = surface_.normal(feet_[i].sample);
        for (unsigned left = felt; left != 0; left &= left - 1) {
            const auto lane = static_cast<std::size_t>(std::countr_zero(left));
            const Index j = others.particles[lane];
            const Vec3f force = repulsion(positions_[i], positions_[j], pairs.radius[lane]);
            if (radius >= 1 && pairs.distance[lane] > 0)
                along += force;
            else
                along += along_plane(force, pairs.overlap[lane], normal, i < j);
        }
    }
    return along + Vec3f(static_cast<float>(sum(x)), static_cast<float>(sum(y)),
                         static_cast<float>(sum(z)));
}

/// What `move` will read of the surface: particles stand far apart among the samples, which are too
/// many for the caches. That takes a third off a step of few particles among many samples.
void ParticleRelaxation::fetch_ahead_of(std::size_t i, std::size_t end) const noexcept {
    constexpr std::size_t kNear = 4, kFar = 8;
    surface_.fetch(feet_[std::min(i + kFar, end - 1)]);
    const std::size_t next = std::min(i + kNear, end - 1);
    if (feet_[next].slack < steps_[next].norm()) surface_.fetch_neighbors(feet_[next]);
}

/// Whether particle i may move: else nothing has changed around it since it came to rest.
bool ParticleRelaxation::is_awake(std::size_t i) const noexcept {
    return moved_[i] != 0 || std::ranges::any_of(neighborhoods_[i / kBlock].of(i % kBlock),
                                                 [&](Index j) { return moved_[j] != 0; });
}

ParticleRelaxation::BlockProgress ParticleRelaxation::move(std::size_t begin, std::size_t end,
                                                           float radius) {
    BlockProgress progress;
    for (std::size_t i = begin; i < end; ++i) {
        const Vec3f p = positions_[i];
        next_[i] = p;
        moves_[i] = 0;
        fetch_ahead_of(i, end);
        if (!is_awake(i)) continue;
        const float own = spacing(i), longest = kLongestStep * own;
        bool is_crowded = false;
        Vec3f step = kMomentum * steps_[i] + kForce * force_on(i, radius, is_crowded);
        progress.crowded += is_crowded ? 1U : 0U;
        const float length = step.norm();
        if (length > kResting * own) {
            if (length > longest) step *= longest / length;
            next_[i] = surface_.project(p, p + step, feet_[i]);
            if (settled_) next_[i] = surface_.settle(next_[i], feet_[i], own);
        }
        steps_[i] = next_[i] - p;
        moves_[i] = steps_[i] != Vec3f::Zero();
        progress.step_sum += static_cast<double>(steps_[i].norm() / own);
        // Two particles may have come nearer by twice this since their neighbours were found.
        const float drift = 0.5F * (kReach - radius) * own;
        progress.strangers += (next_[i] - found_at_[i]).squaredNorm() > drift * drift ? 1U : 0U;
    }
    return progress;
}

}  // namespace stipple
