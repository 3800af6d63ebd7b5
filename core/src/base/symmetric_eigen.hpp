#pragma once

#include "stipple/point_cloud.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace stipple {

/// A symmetric 3x3 matrix by its upper triangle.
struct Symmetric3 {
    double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;

    double trace() const noexcept { return xx + yy + zz; }
};

inline double largest_entry(const Symmetric3& a) noexcept {
    return std::max({std::abs(a.xx), std::abs(a.xy), std::abs(a.xz), std::abs(a.yy), std::abs(a.yz),
                     std::abs(a.zz)});
}

/// Eigenvalues, ascending: the trigonometric solution of the characteristic polynomial (O. K. Smith
/// 1961), on the matrix divided by its largest entry so that nothing under- or overflows. Absolute
/// accuracy about 1e-15 of the largest.
inline std::array<double, 3> eigenvalues(const Symmetric3& a) noexcept {
    const double scale = largest_entry(a);
    if (!(scale > 0)) return {0, 0, 0};
    const double s = 1.0 / scale;
    const double xx = a.xx * s, xy = a.xy * s, xz = a.xz * s, yy = a.yy * s, yz = a.yz * s,
                 zz = a.zz * s;
    const double mean = (xx + yy + zz) / 3.0;
    const double dx = xx - mean, dy = yy - mean, dz = zz - mean;
    const double off = xy * xy + xz * xz + yz * yz;
    const double spread = std::sqrt((dx * dx + dy * dy + dz * dz + 2.0 * off) / 6.0);
    if (!(spread > 0)) return {a.xx, a.yy, a.zz};
    const double determinant =
        dx * (dy * dz - yz * yz) - xy * (xy * dz - yz * xz) + xz * (xy * yz - dy * xz);
    const double r = std::clamp(determinant / (2.0 * spread * spread * spread), -1.0, 1.0);
    const double angle = std::acos(r) / 3.0;
    const double highest = mean + 2.0 * spread * std::cos(angle);
    const double lowest = mean + 2.0 * spread * std::cos(angle + 2.0 * std::numbers::pi / 3.0);
    const double middle = std::clamp(3.0 * mean - highest - lowest, lowest, highest);
    return {lowest * scale, middle * scale, highest * scale};
}

/// A unit eigenvector of an extreme eigenvalue `value`. Where the eigenspace is a plane or
/// everything, one of its vectors.
inline Vec3d eigenvector(const Symmetric3& a, double value) noexcept {
    const Symmetric3 shifted = {a.xx - value, a.xy, a.xz, a.yy - value, a.yz, a.zz - value};
    const double scale = largest_entry(shifted);
    if (!(scale > 0)) return Vec3d::UnitX();
    const double by = 1.0 / scale;  // so that no product under- or overflows
    const std::array<Vec3d, 3> rows = {by * Vec3d(shifted.xx, shifted.xy, shifted.xz),
                                       by * Vec3d(shifted.xy, shifted.yy, shifted.yz),
                                       by * Vec3d(shifted.xz, shifted.yz, shifted.zz)};
    // The rows span what is orthogonal to the eigenvector.
    const std::array<Vec3d, 3> crossed = {rows[0].cross(rows[1]), rows[1].cross(rows[2]),
                                          rows[2].cross(rows[0])};
    const std::array<double, 3> length_sq = {crossed[0].squaredNorm(), crossed[1].squaredNorm(),
                                             crossed[2].squaredNorm()};
    const std::size_t best = length_sq[0] >= length_sq[1] ? (length_sq[0] >= length_sq[2] ? 0 : 2)
                                                          : (length_sq[1] >= length_sq[2] ? 1 : 2);
    constexpr double kParallel = 1e-20;
    if (length_sq[best] > kParallel) return crossed[best] / std::sqrt(length_sq[best]);

    // They are parallel: it may be anything across them.
    const Vec3d& row =
        *std::ranges::max_element(rows, {}, [](const Vec3d& r) { return r.squaredNorm(); });
    const Vec3d axis =
        std::abs(row.x()) <= std::abs(row.y()) && std::abs(row.x()) <= std::abs(row.z())
            ? Vec3d::UnitX()
        : std::abs(row.y()) <= std::abs(row.z()) ? Vec3d::UnitY()
                                                 : Vec3d::UnitZ();
    return row.cross(axis).normalized();
}

}  // namespace stipple
