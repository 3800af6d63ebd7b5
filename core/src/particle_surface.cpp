#include "particle_surface.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace stipple {

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
        for (const Index j : samples_.neighbors.of(foot.sample)) {
            const float distance_sq = (samples_.positions[j] - p).squaredNorm();
            second_sq = std::min(second_sq, distance_sq);
            if (distance_sq < next_sq) {
                next_sq = distance_sq;
                next = j;
            }
        }
        if (next == foot.sample) {
            // The nearest stays the same while the particle moves by less than half of this.
            foot.slack = 0.5F * (std::sqrt(second_sq) - std::sqrt(nearest_sq));
            return;
        }
        foot.sample = next;
        nearest_sq = next_sq;
    }
}

ParticleSurface::Projection ParticleSurface::onto_plane(const Vec3f& p,
                                                        Index sample) const noexcept {
    const Vec3f& normal = samples_.normals[sample];
    Vec3f offset = p - samples_.positions[sample];
    offset -= normal * normal.dot(offset);
    const float outward = samples_.outward[sample].dot(offset), outer = samples_.outer[sample];
    const bool leaves = outward > outer;
    if (leaves) offset -= samples_.outward[sample] * (outward - outer);
    const float distance = offset.norm(), border = samples_.border(sample);
    if (distance > border) offset *= border / distance;
    return {samples_.positions[sample] + offset, leaves || distance > border};
}

Vec3f ParticleSurface::project(const Vec3f& from, const Vec3f& to, Foot& foot) const noexcept {
    foot.slack -= (to - from).norm();
    if (foot.slack < 0) walk(to, foot);
    Projection projection = onto_plane(to, foot.sample);
    if (projection.held_back) {
        // Perhaps the walk came to no end, or the surface goes on where no neighbours lead.
        foot.sample = nearest(to);
        foot.slack = 0;
        projection = onto_plane(to, foot.sample);
    }
    foot.slack -= (projection.point - to).norm();
    return projection.point;
}

Vec3f ParticleSurface::settle(const Vec3f& p, const Foot& foot, float spacing) const {
    constexpr float kFar = 0.5F, kBeyond = 0.05F;  // what is curved bulges beyond its points
    const float radius = samples_.radii[foot.sample];
    const Vec3f settled = frame_.inside(mls_.project(frame_.outside(p)).point);
    const bool near = (settled - p).norm() <= kFar * std::max(spacing, radius);
    const Vec3f beyond = Vec3f::Constant(kBeyond * radius);
    return (near ? settled : p).cwiseMax(frame_.low - beyond).cwiseMin(frame_.high + beyond);
}

}  // namespace stipple
