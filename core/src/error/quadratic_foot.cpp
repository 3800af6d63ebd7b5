#include "error/quadratic_foot.hpp"

#include <algorithm>
#include <cmath>

namespace stipple {

QuadraticFoot::QuadraticFoot(std::span<const Vec3f> points, const PointTree& tree,
                             const FootFinder::Options& options)
    : points_(points), options_(options), search_(tree, options.k, 2 * std::size_t{options.k}) {}

Foot QuadraticFoot::find(const Vec3d& q, const Foot& linear) {
    if (!linear.converged || linear.beyond || linear.line > 0) return linear;
    Foot foot = linear;
    foot.converged = false;
    for (unsigned i = 0; i < options_.max_iterations && !foot.converged; ++i) {
        const Vec3d x = foot.point;
        const std::span<Neighbor> found = search_.find_nearest_few(x.cast<float>());
        around_.resize(found.size());
        double radius_sq = 0;
        for (std::size_t j = 0; j < found.size(); ++j) {
            const Vec3d d = points_[found[j].index].cast<double>() - x;
            around_.x[j] = d.x();
            around_.y[j] = d.y();
            around_.z[j] = d.z();
            radius_sq = std::max(radius_sq, d.squaredNorm());
        }
        foot.radius = std::sqrt(radius_sq);
        foot.h = foot.radius / 3.0;
        if (foot.h == 0) return linear;
        const MlsPlane plane = fit_weighted_plane(around_, foot.h);
        if (plane.kind != MlsPlane::Kind::Weighted) return linear;
        const MlsHeight g = fit_polynomial(around_, plane.n, plane.q, foot.h, 2);
        const Vec3d on_surface = x + plane.q + g.height * plane.n;
        const double height = g.normal.dot(q - on_surface);
        foot.point = q - height * g.normal;
        foot.normal = g.normal;
        foot.distance = std::abs(height);
        foot.converged = (foot.point - x).norm() <= options_.tolerance * foot.h;
    }
    return foot.converged ? foot : linear;
}

}  // namespace stipple
