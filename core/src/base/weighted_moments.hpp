#pragma once

#include "base/symmetric_eigen.hpp"
#include "stipple/point_cloud.hpp"

namespace stipple {

/// Sums over weighted points, of which one weight at least is positive.
class WeightedMoments {
public:
    void add(const Vec3d& p, double weight) noexcept {
        total_ += weight;
        sum_ += weight * p;
        products_.xx += weight * p.x() * p.x();
        products_.xy += weight * p.x() * p.y();
        products_.xz += weight * p.x() * p.z();
        products_.yy += weight * p.y() * p.y();
        products_.yz += weight * p.y() * p.z();
        products_.zz += weight * p.z() * p.z();
    }

    Vec3d mean() const noexcept { return sum_ / total_; }
    /// About the mean. Exact where the points are about as near to the origin as to each other.
    Symmetric3 covariance() const noexcept {
        const Vec3d m = mean();
        return {products_.xx / total_ - m.x() * m.x(), products_.xy / total_ - m.x() * m.y(),
                products_.xz / total_ - m.x() * m.z(), products_.yy / total_ - m.y() * m.y(),
                products_.yz / total_ - m.y() * m.z(), products_.zz / total_ - m.z() * m.z()};
    }

private:
    double total_ = 0;
    Vec3d sum_ = Vec3d::Zero();
    Symmetric3 products_;
};

}  // namespace stipple
