#include "analysis/mls_fit.hpp"

#include "base/symmetric_eigen.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <span>

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

/// The sum of the products of two eigenvalues each; exact where two of them are near 0, which
/// `eigenvalues` are not.
double second_invariant(const Symmetric3& a) noexcept {
    return (a.xx * a.yy - a.xy * a.xy) + (a.yy * a.zz - a.yz * a.yz) + (a.xx * a.zz - a.xz * a.xz);
}

/// The plane of weighted least squares, or what there is of one.
MlsPlane weighted_plane(const MlsNeighborhood& around, const MlsKernels& kernels) {
    const MlsColumns columns = around.columns();
    const Vec3d r = Vec3d::Zero();
    const MlsMoments first = kernels.moments(columns, r.data());
    const Vec3d mean = Vec3d(first.x, first.y, first.z) / first.w;
    const MlsMoments m = kernels.moments(columns, mean.data());
    const Symmetric3 covariance = {m.xx, m.xy, m.xz, m.yy, m.yz, m.zz};
    const std::array<double, 3> lambda = eigenvalues(covariance);
    MlsPlane plane;
    if (!(lambda[2] > 0)) {
        plane.kind = MlsPlane::Kind::Point;
        plane.q = mean;
        if (mean.squaredNorm() > 0) plane.n = mean.normalized();
        plane.t = plane.n.dot(mean);
    } else if (second_invariant(covariance) <= kLineRatio * lambda[2] * lambda[2]) {
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

MlsTrial trial_of(const MlsPlane& plane, const Vec3d& e1, const Vec3d& e2, double h) {
    return {{plane.n.x(), plane.n.y(), plane.n.z()},
            {e1.x(), e1.y(), e1.z()},
            {e2.x(), e2.y(), e2.z()},
            plane.t,
            h};
}

/// Moves the plane by Newton's step. False, and nothing done, where that leads to no minimum.
/// @param step  its length, in input units.
bool newton_step(const MlsNeighborhood& around, double h, const MlsKernels& kernels,
                 MlsPlane& plane, double& step) {
    const Vec3d e1 = plane.n.unitOrthogonal(), e2 = plane.n.cross(e1);
    const MlsDerivatives d = kernels.derivatives(around.columns(), trial_of(plane, e1, e2, h));
    Eigen::Matrix3d H;
    H << d.aa - d.along_n, d.ab, d.at, d.ab, d.bb - d.along_n, d.bt, d.at, d.bt, d.tt;
    const double minor = H(0, 0) * H(1, 1) - H(0, 1) * H(0, 1), determinant = H.determinant();
    if (!(H(0, 0) > 0 && minor > 0 && determinant > 0)) return false;
    const Vec3d delta = -(H.inverse() * Vec3d(d.a, d.b, d.t));
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

constexpr std::size_t kMaxTerms = MlsKernels::kMaxTerms;

std::size_t term_count(unsigned degree) noexcept {
    return (degree + std::size_t{1}) * (degree + 2) / 2;
}

using TermMatrix = std::array<std::array<double, kMaxTerms>, kMaxTerms>;

/// Factors the matrix of a least squares problem of n terms in place, by its lower triangle. A
/// term that those before it make up is left out.
/// @return the inverses of the pivots; 0 for what is left out.
std::array<double, kMaxTerms> factorise(TermMatrix& A, std::size_t n) {
    constexpr double kDependent = 1e-11;
    std::array<double, kMaxTerms> inverse{};
    for (std::size_t j = 0; j < n; ++j) {
        double pivot = A[j][j];
        for (std::size_t k = 0; k < j; ++k) pivot -= A[j][k] * A[j][k] * inverse[k];
        inverse[j] = pivot > kDependent * A[j][j] ? 1.0 / pivot : 0.0;
        for (std::size_t i = j + 1; i < n; ++i) {
            for (std::size_t k = 0; k < j; ++k) A[i][j] -= A[i][k] * A[j][k] * inverse[k];
        }
    }
    return inverse;
}

/// Solves A c = b by the factors of A.
void substitute(const TermMatrix& A, std::span<const double> inverse, std::span<double> b) {
    const std::size_t n = b.size();
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t k = 0; k < i; ++k) b[i] -= A[i][k] * inverse[k] * b[k];
    for (std::size_t i = n; i-- > 0;) {
        b[i] *= inverse[i];
        for (std::size_t k = i + 1; k < n; ++k) b[i] -= A[k][i] * inverse[i] * b[k];
    }
}

}  // namespace

void MlsNeighborhood::resize(std::size_t n) {
    constexpr std::size_t kLanes = MlsColumns::kLanes;
    size_ = n;
    const std::size_t filled = (n + kLanes - 1) / kLanes * kLanes;
    for (std::vector<double>* column : {&x, &y, &z, &weight}) {
        column->resize(filled);
        std::fill(column->begin() + static_cast<std::ptrdiff_t>(n), column->end(), 0.0);
    }
}

MlsPlane fit_weighted_plane(MlsNeighborhood& around, double h) {
    const MlsKernels& kernels = mls_kernels();
    const Vec3d r = Vec3d::Zero();
    kernels.weigh(around.columns(), r.data(), h, around.weight.data());
    return weighted_plane(around, kernels);
}

MlsPlane fit_plane(MlsNeighborhood& around, double h, unsigned max_iterations, double tolerance) {
    const MlsKernels& kernels = mls_kernels();
    MlsPlane plane = fit_weighted_plane(around, h);
    for (unsigned i = 0; i < max_iterations; ++i) {
        if (plane.kind == MlsPlane::Kind::Line || plane.kind == MlsPlane::Kind::Point) return plane;
        kernels.weigh(around.columns(), plane.q.data(), h, around.weight.data());
        double step = 0;
        if (newton_step(around, h, kernels, plane, step)) {
            if (step <= tolerance * h) return plane;
        } else {
            plane = weighted_plane(around, kernels);
        }
    }
    plane.kind = MlsPlane::Kind::Weighted;
    return plane;
}

MlsHeight fit_polynomial(const MlsNeighborhood& around, const Vec3d& n, const Vec3d& q, double h,
                         unsigned degree) {
    while (degree > 0 && term_count(degree) > around.size()) --degree;
    if (degree == 0) return {0.0, n};
    MlsPlane plane;
    plane.n = n;
    plane.t = n.dot(q);
    const Vec3d e1 = n.unitOrthogonal(), e2 = n.cross(e1);
    TermMatrix A;
    std::array<double, kMaxTerms> b;
    const double highest = mls_kernels().normal_equations(
        around.columns(), trial_of(plane, e1, e2, h), degree, A.front().data(), b.data());
    const std::size_t terms = term_count(degree);
    substitute(A, factorise(A, terms), std::span(b).first(terms));
    // In a gap of what is curved the surface lies higher than all points around, but not much.
    constexpr double kBeyond = 1.5;
    if (!(std::abs(b[0]) <= kBeyond * highest)) return fit_polynomial(around, n, q, h, degree - 1);
    return {b[0], (n - (b[1] * e1 + b[2] * e2) / h).normalized()};
}

}  // namespace stipple
