#include "particle_surface.hpp"

#include <array>
#include <cmath>

namespace stipple {

ParticleFrame::ParticleFrame(std::span<const Vec3f> points) {
    Vec3f low = points.front(), high = low;
    for (const Vec3f& p : points) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
    center = 0.5 * (low.cast<double>() + high.cast<double>());
    const double extent = (high.cast<double>() - low.cast<double>()).maxCoeff();
    scale = extent > 0 ? std::ldexp(1.0, std::ilogb(extent)) : 0;
}

Vec3f ParticleSurface::project(const Vec3f& from, const Vec3f& to, Foot& foot) const noexcept {
    // While it has moved by less than half of what the second nearest sample is further away than
    // the nearest, the nearest stays the same: most particles of late iterations need no search.
    foot.slack -= (to - from).norm();
    if (foot.slack < 0) {
        std::array<Neighbor, 2> room;
        const std::span<Neighbor> nearest = search_.nearest(to, room);
        foot.sample = nearest.front().index;
        foot.slack =
            nearest.size() < 2
                ? 0
                : 0.5F * (std::sqrt(nearest[1].distance_sq) - std::sqrt(nearest[0].distance_sq));
    }
    const Vec3f& sample = samples_.positions[foot.sample];
    const Vec3f& normal = samples_.normals[foot.sample];
    Vec3f offset = to - sample;
    offset -= normal * normal.dot(offset);
    // No place inside of evenly spread samples is further than about 0.3 radii from all of them.
    constexpr float kBorder = 0.4F;
    const float distance = offset.norm(), border = kBorder * samples_.radii[foot.sample];
    if (distance > border) offset *= border / distance;
    const Vec3f projected = sample + offset;
    foot.slack -= (projected - to).norm();
    return projected;
}

Vec3f ParticleSurface::settle(const Vec3f& p, const Foot& foot, float spacing) const {
    constexpr float kFar = 0.5F;
    const Vec3f settled =
        ((mls_.project(frame_.outside(p)).point - frame_.center) / frame_.scale).cast<float>();
    return (settled - p).norm() <= kFar * std::max(spacing, samples_.radii[foot.sample]) ? settled
                                                                                         : p;
}

}  // namespace stipple
