#include "mls_fit.hpp"

#include "gaussian.hpp"
#include "symmetric_eigen.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

// Follows: Levin 2003, Alexa et al. 2003 (the energy of Eq. 6 as a function of n and t, whose
// weights move with q = r + t n). With m = n . (p - r) and s = m - t a term is
//
//     s^2 exp(-|p - r|^2 / h^2) exp((2 t m - t^2) / h^2),
//
// so n enters through m alone and the second derivatives are short: Newton's method on (n, t)
// stands in place of the alternation of line search and conjugate gradients. The energy falls to 0
// far from all points; a start by weighted least squares with the weights held fast, repeated while
// Newton's matrix is not positive definite, leads to the minimum at the surface.

namespace stipple {

namespace {

/// Neighbours of less extent across a line than this part of the extent along it (its square root)
/// carry no plane.
constexpr double kLineRatio = 1e-9;

/// Centres the weights at c. They are those of Eq. 6 up to a factor, which keeps the largest at 1.
void weigh(MlsNeighborhood& around, const Vec3d& c, double h) {
    const std::size_t n = around.size();
    const double* const x = around.x.data();
    const double* const y = around.y.data();
    const double* const z = around.z.data();
    double* const weight = around.weight.data();
    const double by = 1.0 / (h * h);
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < n; ++i) {
        const double dx = x[i] - c.x(), dy = y[i] - c.y(), dz = z[i] - c.z();
        weight[i] = (dx * dx + dy * dy + dz * dz) * by;
        least = std::min(least, weight[i]);
    }
    for (std::size_t i = 0; i < n; ++i) weight[i] = gaussian(weight[i] - least);
}

/// The plane of weighted least squares, or what there is of one.
MlsPlane weighted_plane(const MlsNeighborhood& around) {
    double total = 0;
    Vec3d mean = Vec3d::Zero();
    for (std::size_t i = 0; i < around.size(); ++i) {
        const double w = around.weight[i];
        total += w;
        mean += w * Vec3d(around.x[i], around.y[i], around.z[i]);
    }
    mean /= total;
    Symmetric3 covariance;
    for (std::size_t i = 0; i < around.size(); ++i) {
        const double w = around.weight[i];
        const double x = around.x[i] - mean.x(), y = around.y[i] - mean.y(),
                     z = around.z[i] - mean.z();
        covariance.xx += w * x * x;
        covariance.xy += w * x * y;
        covariance.xz += w * x * z;
        covariance.yy += w * y * y;
        covariance.yz += w * y * z;
        covariance.zz += w * z * z;
    }
    const std::array<double, 3> lambda = eigenvalues(covariance);
    MlsPlane plane;
    if (!(lambda[2] > 0)) {
        plane.kind = MlsPlane::Kind::Point;
        plane.q = mean;
        if (mean.squaredNorm() > 0) plane.n = mean.normalized();
        plane.t = plane.n.dot(mean);
    } else if (lambda[1] <= kLineRatio * lambda[2]) {
        plane.kind = MlsPlane::Kind::Line;
        const Vec3d along = eigenvector(covariance, lambda[2]);
        plane.q = mean - along.dot(mean) * along;
        plane.n = plane.q.squaredNorm() > 0 ? plane.q.normalized() : along.unitOrthogonal();
        plane.t = plane.q.norm();
    } else {
        plane.kind = MlsPlane::Kind::Weighted;
        plane.n = eigenvector(covariance, lambda[0]);
        plane.t = plane.n.dot(mean);
        plane.q = plane.t * plane.n;
    }
    return plane;
}

/// First and second derivatives of Eq. 6 by (n . e1, n . e2, t), without a common factor of 2.
struct Derivatives {
    Vec3d gradient = Vec3d::Zero();
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
};

Derivatives derivatives(const MlsNeighborhood& around, const MlsPlane& plane, const Vec3d& e1,
                        const Vec3d& e2, double h) {
    const double g = 1.0 / (h * h), t = plane.t;
    const Vec3d n = plane.n;
    double f_a = 0, f_b = 0, f_t = 0, f_aa = 0, f_ab = 0, f_bb = 0, f_at = 0, f_bt = 0, f_tt = 0,
           along_n = 0;
    for (std::size_t i = 0; i < around.size(); ++i) {
        const double x = around.x[i], y = around.y[i], z = around.z[i], w = around.weight[i];
        const double a = e1.x() * x + e1.y() * y + e1.z() * z;
        const double b = e2.x() * x + e2.y() * y + e2.z() * z;
        const double m = n.x() * x + n.y() * y + n.z() * z;
        const double s = m - t, ss = s * s * g, st = s * t * g;
        const double by_m = w * s * (1.0 + st);
        const double by_t = w * s * (ss - 1.0);
        const double by_mm = w * (1.0 + 4.0 * st + 2.0 * st * st);
        const double by_mt = w * (3.0 * ss - 1.0 + 2.0 * st * (ss - 1.0));
        const double by_tt = w * (1.0 - 5.0 * ss + 2.0 * ss * ss);
        f_a += by_m * a;
        f_b += by_m * b;
        f_t += by_t;
        f_aa += by_mm * a * a;
        f_ab += by_mm * a * b;
        f_bb += by_mm * b * b;
        f_at += by_mt * a;
        f_bt += by_mt * b;
        f_tt += by_tt;
        along_n += by_m * m;
    }
    Derivatives d;
    d.gradient = {f_a, f_b, f_t};
    d.hessian << f_aa - along_n, f_ab, f_at, f_ab, f_bb - along_n, f_bt, f_at, f_bt, f_tt;
    return d;
}

/// Moves the plane by Newton's step. False, and nothing done, where that leads to no minimum.
/// @param step  its length, in input units.
bool newton_step(const MlsNeighborhood& around, double h, MlsPlane& plane, double& step) {
    const Vec3d e1 = plane.n.unitOrthogonal(), e2 = plane.n.cross(e1);
    const Derivatives d = derivatives(around, plane, e1, e2, h);
    const Eigen::Matrix3d& H = d.hessian;
    const double minor = H(0, 0) * H(1, 1) - H(0, 1) * H(0, 1), determinant = H.determinant();
    if (!(H(0, 0) > 0 && minor > 0 && determinant > 0)) return false;
    const Vec3d delta = -(H.inverse() * d.gradient);
    constexpr double kTrusted = 0.5;
    const double turn = std::hypot(delta.x(), delta.y());
    if (!(turn <= kTrusted && std::abs(delta.z()) <= kTrusted * h)) return false;
    plane.n = (plane.n + delta.x() * e1 + delta.y() * e2).normalized();
    plane.t += delta.z();
    plane.q = plane.t * plane.n;
    plane.kind = MlsPlane::Kind::Minimum;
    step = std::max(std::abs(delta.z()), turn * h);
    return true;
}

constexpr unsigned kMaxDegree = 4;
constexpr std::size_t kMaxTerms = (kMaxDegree + 1) * (kMaxDegree + 2) / 2;

std::size_t term_count(unsigned degree) noexcept {
    return (degree + std::size_t{1}) * (degree + 2) / 2;
}

/// 1 u v u^2 uv v^2 u^3 ...
void fill_terms(double u, double v, unsigned degree, std::array<double, kMaxTerms>& terms) {
    terms[0] = 1.0;
    std::size_t at = 1;
    for (unsigned d = 1; d <= degree; ++d) {
        const std::size_t before = at - d;
        for (unsigned j = 0; j < d; ++j, ++at) terms[at] = u * terms[before + j];
        terms[at] = v * terms[before + d - 1];
        ++at;
    }
}

/// Solves A c = b for a matrix of a least squares problem, by the lower triangle of A, which is
/// destroyed. A term that those before it make up is left out.
void solve(std::array<std::array<double, kMaxTerms>, kMaxTerms>& A, std::span<double> b) {
    constexpr double kDependent = 1e-11;
    const std::size_t n = b.size();
    std::array<double, kMaxTerms> inverse{};  // of the pivots; 0 for what is left out
    for (std::size_t j = 0; j < n; ++j) {
        double pivot = A[j][j];
        for (std::size_t k = 0; k < j; ++k) pivot -= A[j][k] * A[j][k] * inverse[k];
        inverse[j] = pivot > kDependent * A[j][j] ? 1.0 / pivot : 0.0;
        for (std::size_t i = j + 1; i < n; ++i) {
            for (std::size_t k = 0; k < j; ++k) A[i][j] -= A[i][k] * A[j][k] * inverse[k];
        }
    }
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t k = 0; k < i; ++k) b[i] -= A[i][k] * inverse[k] * b[k];
    for (std::size_t i = n; i-- > 0;) {
        b[i] *= inverse[i];
        for (std::size_t k = i + 1; k < n; ++k) b[i] -= A[k][i] * inverse[i] * b[k];
    }
}

}  // namespace

void MlsNeighborhood::resize(std::size_t n) {
    x.resize(n);
    y.resize(n);
    z.resize(n);
    weight.resize(n);
}

MlsPlane fit_weighted_plane(MlsNeighborhood& around, double h) {
    weigh(around, Vec3d::Zero(), h);
    return weighted_plane(around);
}

MlsPlane fit_plane(MlsNeighborhood& around, double h, unsigned max_iterations, double tolerance) {
    MlsPlane plane = fit_weighted_plane(around, h);
    for (unsigned i = 0; i < max_iterations; ++i) {
        if (plane.kind == MlsPlane::Kind::Line || plane.kind == MlsPlane::Kind::Point) return plane;
        weigh(around, plane.q, h);
        double step = 0;
        if (newton_step(around, h, plane, step)) {
            if (step <= tolerance * h) return plane;
        } else {
            plane = weighted_plane(around);
        }
    }
    plane.kind = MlsPlane::Kind::Weighted;
    return plane;
}

MlsHeight fit_polynomial(const MlsNeighborhood& around, const Vec3d& n, const Vec3d& q, double h,
                         unsigned degree) {
    while (degree > 0 && term_count(degree) > around.size()) --degree;
    if (degree == 0) return {0.0, n};
    const Vec3d e1 = n.unitOrthogonal() / h, e2 = n.cross(e1);
    const std::size_t count = term_count(degree);
    std::array<std::array<double, kMaxTerms>, kMaxTerms> A{};
    std::array<double, kMaxTerms> b{}, terms;
    double highest = 0;
    for (std::size_t i = 0; i < around.size(); ++i) {
        const Vec3d d = Vec3d(around.x[i], around.y[i], around.z[i]) - q;
        fill_terms(e1.dot(d), e2.dot(d), degree, terms);
        const double height = n.dot(d);
        highest = std::max(highest, std::abs(height));
        for (std::size_t j = 0; j < count; ++j) {
            const double weighted = around.weight[i] * terms[j];
            for (std::size_t k = 0; k <= j; ++k) A[j][k] += weighted * terms[k];
            b[j] += weighted * height;
        }
    }
    solve(A, std::span(b).first(count));
    if (!(std::abs(b[0]) <= highest)) return fit_polynomial(around, n, q, h, degree - 1);
    return {b[0], (n - b[1] * e1 - b[2] * e2).normalized()};
}

}  // namespace stipple
