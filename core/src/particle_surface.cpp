#include "particle_surface.hpp"

#include <algorithm>
#include <array>
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
    return search_.nearest(p, room).front().index;
}

/// From sample to neighbouring sample, as long as that leads nearer.
void ParticleSurface::walk(const Vec3f& p, Foot& foot) const noexcept {
    float nearest_sq = (samples_.positions[foot.sample] - p).squaredNorm();
    while (true) {
        float second_sq = std::numeric_limits<float>::max(), next_sq = nearest_sq;
        Index next = foot.sample;
        for (const Index j : samples_.neighbors_of(foot.sample)) {
            const float distance_sq = (samples_.positions[j] - p).squaredNorm();
            second_sq = std::min(second_sq, distance_sq);
            if (distance_sq < next_sq) {
                next_sq = distance_sq;
                next = j;
            }
        }
        if (next == foot.sample) {
            // The nearest stays the same while the particle moves by less than half the difference.
            foot.slack = 0.5F * (std::sqrt(second_sq) - std::sqrt(nearest_sq)) +
                         kAsGood * samples_.planes[foot.sample].radius;
            return;
        }
        foot.sample = next;
        nearest_sq = next_sq;
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
        // Perhaps the walk came to no end, or the surface goes on where no neighbours lead.
        foot.sample = nearest(to);
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
