#include "particle_surface.hpp"

#include <array>
#include <cmath>

namespace stipple {

Vec3f ParticleSurface::project(const Vec3f& from, const Vec3f& to, Foot& foot) const noexcept {
    // While it has moved by less than half of what the second nearest sample is further away than
    // the nearest, the nearest stays the same: most particles of late iterations need no search.
    foot.slack -= (to - from).norm();
    if (foot.slack < 0) {
        std::array<Neighbor, 2> room;
        const std::span<Neighbor> nearest = search_.nearest(to, room);
        foot.sample = nearest.front().index;
        foot.slack = nearest.size() < 2 ? 0
                                        : 0.5F * (std::sqrt(nearest[1].distance_sq) -
                                                  std::sqrt(nearest[0].distance_sq));
    }
    const Vec3f& normal = normals_[foot.sample];
    Vec3f offset = to - samples_[foot.sample];
    offset -= normal * normal.dot(offset);
    const float distance = offset.norm(), border = border_[foot.sample];
    if (distance > border) offset *= border / distance;
    const Vec3f projected = samples_[foot.sample] + offset;
    foot.slack -= (projected - to).norm();
    return projected;
}

}  // namespace stipple
