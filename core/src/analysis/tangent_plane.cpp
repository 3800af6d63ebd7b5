#include "analysis/tangent_plane.hpp"

namespace stipple {

Symmetric3 scatter_of(std::span<const Vec3d> neighbors) noexcept {
    Vec3d sum = Vec3d::Zero();
    Symmetric3 m;
    for (const Vec3d& e : neighbors) {
        sum += e;
        m.xx += e.x() * e.x();
        m.xy += e.x() * e.y();
        m.xz += e.x() * e.z();
        m.yy += e.y() * e.y();
        m.yz += e.y() * e.z();
        m.zz += e.z() * e.z();
    }
    const Vec3d mean =
        sum / (static_cast<double>(neighbors.size()) + 1);  // the sample is among them
    m.xx -= mean.x() * sum.x();
    m.xy -= mean.x() * sum.y();
    m.xz -= mean.x() * sum.z();
    m.yy -= mean.y() * sum.y();
    m.yz -= mean.y() * sum.z();
    m.zz -= mean.z() * sum.z();
    return m;
}

Vec3d normal_from(std::span<const Vec3d> neighbors) noexcept {
    const Symmetric3 m = scatter_of(neighbors);
    return eigenvector(m, eigenvalues(m)[0]);
}

}  // namespace stipple
