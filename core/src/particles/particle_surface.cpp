#include "particles/particle_surface.hpp"

#include "cloud/float4.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

namespace stipple {

namespace {

/// A sample that is farther than the nearest by less than this part of its radius stands for the
/// surface there as well: half of the walks find nothing else.
constexpr float kAsGood = 0.2F;

}  // namespace

Index ParticleSurface::nearest(const Vec3f& p) const noexcept {
    std::array<Neighbor, 1> room;
    return find_nearest(tree_, p, room).front().index;
}

/// The neighbour of a sample that is nearest to p, the first of several; without neighbours the
/// sample itself, as if it were far.
Neighbor ParticleSurface::nearest_neighbor(const Vec3f& p, Index sample) const noexcept {
    constexpr std::size_t kMost = kSampleNeighbors;
    static_assert(kMost == 16);
    const std::span<const Index> near = samples_.neighbors_of(sample);
    if (near.empty()) return {std::numeric_limits<float>::max(), sample};
    std::array<Float4, kMost / 4> distance_sq;
    for (std::size_t four = 0; four < distance_sq.size(); ++four) {
        const auto position = [&](std::size_t lane) -> const Vec3f& {
            return samples_.positions[near[std::min(4 * four + lane, near.size() - 1)]];
        };
        const Vec3f &a = position(0), &b = position(1), &c = position(2), &d = position(3);
        const Float4 x = Float4{a.x(), b.x(), c.x(), d.x()} - p.x(),
                     y = Float4{a.y(), b.y(), c.y(), d.y()} - p.y(),
                     z = Float4{a.z(), b.z(), c.z(), d.z()} - p.z();
        distance_sq[four] = x * x + (y * y + z * z);
    }
    const Float4 of_lanes =
        smaller(smaller(distance_sq[0], distance_sq[1]), smaller(distance_sq[2], distance_sq[3]));
    const float least =
        std::min(std::min(of_lanes[0], of_lanes[1]), std::min(of_lanes[2], of_lanes[3]));
    unsigned are_least = 0;
    for (unsigned four = 0; four < distance_sq.size(); ++four)
        are_least |= lane_bits(distance_sq[four] == splat(least)) << 4 * four;
    return {least, near[static_cast<std::size_t>(std::countr_zero(are_least))]};
}

/// From sample to neighbouring sample, as long as that leads nearer.
void ParticleSurface::walk(const Vec3f& p, Foot& foot) const noexcept {
    float nearest_sq = (samples_.positions[foot.sample] - p).squaredNorm();
    while (true) {
        const Neighbor next = nearest_neighbor(p, foot.sample);
        if (!(next.distance_sq < nearest_sq)) {
            // The nearest stays the same while the particle moves by less than half the difference.
            foot.slack = 0.5F * (std::sqrt(next.distance_sq) - std::sqrt(nearest_sq)) +
                         kAsGood * samples_.planes[foot.sample].radius;
            return;
        }
        foot.sample = next.index;
        nearest_sq = next.distance_sq;
    }
}

ParticleSurface::Projection ParticleSurface::onto_plane(const Vec3f& p,
                                                        Index sample) const noexcept {
    const TangentPlane& plane = samples_.planes[sample];
    Vec3f offset = p - samples_.positions[sample];
    offset -= plane.normal * plane.normal.dot(offset);
    const float outward = plane.outward.dot(offset);
    const bool leaves = outward > plane.outer;
    if (leaves) offset -= plane.outward * (outward - plane.outer);
    const float distance = offset.norm(), border = plane.border();
    if (distance > border) offset *= border / distance;
    return {samples_.positions[sample] + offset, leaves || distance > border};
}

Vec3f ParticleSurface::project(const Vec3f& from, const Vec3f& to, Foot& foot) const noexcept {
    foot.slack -= (to - from).norm();
    if (foot.slack < 0) walk(to, foot);
    Projection projection = onto_plane(to, foot.sample);
    if (projection.held_back && foot.unasked <= 0) {
        // Perhaps the walk came to no end, or the surface goes on where no neighbours lead. Mostly
        // not, which is soon known.
        const float nearer_sq =
            std::nextafter((samples_.positions[foot.sample] - to).squaredNorm(), 0.0F);
        if (any_within(tree_, to, nearer_sq)) foot.sample = nearest(to);
        foot.slack = foot.unasked = kAsGood * samples_.planes[foot.sample].radius;
        projection = onto_plane(to, foot.sample);
    }
    foot.slack -= (projection.point - to).norm();
    foot.unasked -= (projection.point - from).norm();
    return projection.point;
}

Vec3f ParticleSurface::settle(const Vec3f& p, const Foot& foot, float spacing) const {
    constexpr float kFar = 0.5F, kBeyond = 0.05F;  // what is curved bulges beyond its points
    const float radius = samples_.planes[foot.sample].radius;
    const Vec3f settled = frame_.inside(mls_.project(frame_.outside(p)).point);
    const bool near = (settled - p).norm() <= kFar * std::max(spacing, radius);
    const Vec3f beyond = Vec3f::Constant(kBeyond * radius);
    return (near ? settled : p).cwiseMax(frame_.low - beyond).cwiseMin(frame_.high + beyond);
}

}  // namespace stipple
