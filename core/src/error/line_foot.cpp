#include "error/line_foot.hpp"

#include "base/gaussian.hpp"
#include "base/symmetric_eigen.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace stipple {

namespace {

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

}  // namespace

double line_part(double breadth, double roundness) noexcept {
    // How far a value is from one to another, 0..1.
    const auto part = [](double value, double none, double all) {
        return std::clamp((value - none) / (all - none), 0.0, 1.0);
    };
    const double is_thin = part(breadth, 8e-4, 2e-4), is_slim = part(breadth, 0.016, 0.004),
                 is_round = part(roundness, 0.05, 0.2);
    return std::max(is_thin, std::min(is_slim, is_round));
}

double line_scale(unsigned k) noexcept {
    return 2 / std::sqrt(std::numbers::pi * k);
}

std::optional<LocalLine> fit_line(const PointsByAxis& points, const Vec3d& place, double h,
                                  double radius) {
    double nearest_sq = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < points.size; ++i)
        nearest_sq = std::min(nearest_sq, (points[i] - place).squaredNorm());
    const double h_sq = std::max(h * h, nearest_sq);
    if (!(h_sq > 0)) return std::nullopt;
    const double reach_sq = std::max(nearest_sq, std::min(9 * h_sq, radius * radius));
    WeightedMoments moments;
    for (std::size_t i = 0; i < points.size; ++i) {
        const Vec3d d = points[i] - place;
        if (d.squaredNorm() <= reach_sq) moments.add(d, gaussian(d.squaredNorm() / h_sq));
    }
    const Symmetric3 covariance = moments.covariance();
    constexpr double kPoint = 1e-12;  // of h, squared: what rounding leaves
    if (covariance.trace() <= kPoint * h_sq) return std::nullopt;
    return LocalLine{place + moments.mean(), eigenvector(covariance, eigenvalues(covariance)[2])};
}

}  // namespace stipple
