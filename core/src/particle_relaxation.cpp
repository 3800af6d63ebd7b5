#include "particle_relaxation.hpp"

#include "first_touch.hpp"
#include "parallel_for.hpp"
#include "until_stopped.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
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

}  // namespace

ParticleRelaxation::ParticleRelaxation(const ParticleSurface& surface, std::vector<float> spacing,
                                       SpreadParticles start, const RunContext& context)
    : surface_(surface),
      context_{context.stop, {}, context.threads},
      spacing_(std::move(spacing)),
      positions_(std::move(start.positions)) {
    feet_.reserve(positions_.size());
    for (const Index sample : start.samples) feet_.push_back({.sample = sample});
    resize(positions_.size());
    look_up_spacing();
}

void ParticleRelaxation::resize(std::size_t count) {
    resize_in_blocks(next_, count, context_);
    steps_.clear();
    resize_in_blocks(steps_, count, context_);
    parallel_for_blocks(count, kBlock, context_, [&](std::size_t begin, std::size_t end) {
        std::fill(&steps_[begin], &steps_[begin] + (end - begin), Vec3f::Zero());
    });
    resize_in_blocks(relative_, count, context_);
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
    look_up_spacing();
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
    look_up_spacing();
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

void ParticleRelaxation::look_up_spacing() {
    parallel_for_blocks(relative_.size(), kBlock, context_,
                        [&](std::size_t begin, std::size_t end) {
                            for (std::size_t i = begin; i < end; ++i)
                                relative_[i] = spacing_[feet_[i].sample];
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
/// reach count as if they were just there. Of all particles or some hundred blocks of them.
double ParticleRelaxation::mean_ring() const {
    constexpr std::size_t kAsked = 128;
    const std::size_t stride = (neighborhoods_.size() + kAsked - 1) / kAsked;
    std::vector<double> sums((neighborhoods_.size() + stride - 1) / stride);
    std::vector<std::size_t> counts(sums.size());
    parallel_for_blocks(sums.size(), 1, context_, [&](std::size_t b, std::size_t) {
        const std::size_t begin = b * stride * kBlock;
        const std::size_t end = std::min(positions_.size(), begin + kBlock);
        for (std::size_t i = begin; i < end; ++i) sums[b] += static_cast<double>(mean_of_ring(i));
        counts[b] = end - begin;
    });
    return std::accumulate(sums.begin(), sums.end(), 0.0) /
           static_cast<double>(std::accumulate(counts.begin(), counts.end(), std::size_t{0}));
}

float ParticleRelaxation::mean_of_ring(std::size_t i) const {
    std::array<float, kRing> nearest;
    nearest.fill(kReach);
    for (const Index j : neighborhoods_[i / kBlock].of(i % kBlock)) {
        float distance = 2 * (positions_[j] - positions_[i]).norm() / (spacing(i) + spacing(j));
        for (float& place : nearest)
            if (distance < place) std::swap(distance, place);
    }
    return std::accumulate(nearest.begin(), nearest.end(), 0.0F) / kRing;
}

/// The total force (Eq. 8) on particle i.
Vec3f ParticleRelaxation::force_on(std::size_t i, float radius, float& largest_overlap) const {
    const Vec3f p = positions_[i];
    const Vec3f normal = surface_.normal(feet_[i].sample);
    Vec3f total = Vec3f::Zero();
    for (const Index j : neighborhoods_[i / kBlock].of(i % kBlock)) {
        const float r = radius * 0.5F * (spacing(i) + spacing(j));
        const Vec3f force = repulsion(p, positions_[j], r);
        const float length = positions_[j] == p ? r : force.norm();
        if (length == 0) continue;
        largest_overlap = std::max(largest_overlap, length / r);
        total += radius < 1 || length == r ? along_plane(force, length, normal, i < j) : force;
    }
    return total;
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
        if (!is_awake(i)) continue;
        const float own = spacing(i), longest = kLongestStep * own;
        float overlap = 0;
        Vec3f step = kMomentum * steps_[i] + kForce * force_on(i, radius, overlap);
        progress.crowded += overlap > kCrowded ? 1U : 0U;
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
