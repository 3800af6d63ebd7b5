#include "error/line_foot.hpp"

#include "base/gaussian.hpp"
#include "base/symmetric_eigen.hpp"
#include "base/weighted_moments.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace stipple {

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
