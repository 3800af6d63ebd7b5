#pragma once

#include "analysis/mls_fit.hpp"
#include "error/foot_finder.hpp"
#include "neighbors/nearby_search.hpp"

#include <span>

namespace stipple {

/// Feet on the MLS surface with a quadratic basis: over the plane of `FootFinder` at x a quadratic
/// polynomial, whose tangent plane takes the plane's place in the iteration.
class QuadraticFoot {
public:
    QuadraticFoot(std::span<const Vec3f> points, const PointTree& tree,
                  const FootFinder::Options& options);

    /// The foot of q near its foot on the linear surface. That itself where it is none of that
    /// surface.
    Foot find(const Vec3d& q, const Foot& linear);

private:
    std::span<const Vec3f> points_;
    const FootFinder::Options& options_;
    MlsNeighborhood around_;
    NearbySearch search_;
};

}  // namespace stipple
