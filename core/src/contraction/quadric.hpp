#pragma once

#include "stipple/point_cloud.hpp"

namespace stipple {

/// The sum of weighted squared distances to planes and points as a function of position (Garland
/// and Heckbert 1997): y'Ay + 2b'y + c, with y the position relative to a reference that the owner
/// of the quadric knows. A lies in its upper triangle.
///
/// Sums are taken in doubles; what lies in memory is floats, relative to the sample's own position,
/// where b and c are small and lose nothing. The paper found floats unstable (§5.1) and does not
/// say why; we suppose that its quadrics are relative to the origin of the world.
template <typename Real>
struct BasicQuadric {
    Real xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
    Real x = 0, y = 0, z = 0;
    Real c = 0;

    template <typename Other>
    explicit operator BasicQuadric<Other>() const noexcept {
        const auto to = [](Real value) { return static_cast<Other>(value); };
        return {to(xx), to(xy), to(xz), to(yy), to(yz), to(zz), to(x), to(y), to(z), to(c)};
    }
};
using Quadric = BasicQuadric<double>;
using StoredQuadric = BasicQuadric<float>;

/// Adds weight * (n'(y - p))^2: with a unit normal n, the squared distance to the plane through p.
inline void add_plane(Quadric& q, const Vec3d& n, const Vec3d& p, double weight) noexcept {
    const Vec3d wn = weight * n;
    const double d = -n.dot(p);
    q.xx += wn.x() * n.x();
    q.xy += wn.x() * n.y();
    q.xz += wn.x() * n.z();
    q.yy += wn.y() * n.y();
    q.yz += wn.y() * n.z();
    q.zz += wn.z() * n.z();
    q.x += wn.x() * d;
    q.y += wn.y() * d;
    q.z += wn.z() * d;
    q.c += weight * d * d;
}

/// Adds weight * |y - p|^2.
inline void add_point(Quadric& q, const Vec3d& p, double weight) noexcept {
    q.xx += weight;
    q.yy += weight;
    q.zz += weight;
    q.x -= weight * p.x();
    q.y -= weight * p.y();
    q.z -= weight * p.z();
    q.c += weight * p.squaredNorm();
}

inline Quadric operator+(const Quadric& a, const Quadric& b) noexcept {
    return {a.xx + b.xx, a.xy + b.xy, a.xz + b.xz, a.yy + b.yy, a.yz + b.yz,
            a.zz + b.zz, a.x + b.x,   a.y + b.y,   a.z + b.z,   a.c + b.c};
}

/// A y + b.
inline Vec3d half_gradient(const Quadric& q, const Vec3d& y) noexcept {
    return {q.xx * y.x() + q.xy * y.y() + q.xz * y.z() + q.x,
            q.xy * y.x() + q.yy * y.y() + q.yz * y.z() + q.y,
            q.xz * y.x() + q.yz * y.y() + q.zz * y.z() + q.z};
}

inline double value(const Quadric& q, const Vec3d& y) noexcept {
    return y.dot(half_gradient(q, y) + Vec3d(q.x, q.y, q.z)) + q.c;
}

/// The same function of the position relative to a reference that lies at `y`.
inline Quadric referred_to(const Quadric& q, const Vec3d& y) noexcept {
    const Vec3d b = half_gradient(q, y);
    Quadric moved = q;
    moved.x = b.x();
    moved.y = b.y();
    moved.z = b.z();
    moved.c = value(q, y);
    return moved;
}

/// The same function where lengths are told in another unit, in which they are `factor` times as
/// large; its weights stay.
inline StoredQuadric in_unit(StoredQuadric q, float factor) noexcept {
    q.x *= factor;
    q.y *= factor;
    q.z *= factor;
    q.c *= factor * factor;
    return q;
}

/// Where the quadric is least, by Cholesky's method; false where that is not one well-defined point
/// (a plane or a line of such places). A point term of small weight makes it one.
inline bool minimiser(const Quadric& q, Vec3d& y) noexcept {
    constexpr double kSingular = 1e-12;  // of the trace
    const double least = kSingular * (q.xx + q.yy + q.zz);
    if (!(q.xx > least)) return false;
    const double rx = 1 / q.xx;
    const double lyx = q.xy * rx, lzx = q.xz * rx;
    const double dy = q.yy - lyx * q.xy;
    if (!(dy > least)) return false;
    const double ry = 1 / dy;
    const double ez = q.yz - lyx * q.xz;
    const double lzy = ez * ry;
    const double dz = q.zz - lzx * q.xz - lzy * ez;
    if (!(dz > least)) return false;
    const double u = -q.x, v = -q.y - lyx * u, w = -q.z - lzx * u - lzy * v;
    y.z() = w / dz;
    y.y() = v * ry - lzy * y.z();
    y.x() = u * rx - lyx * y.y() - lzx * y.z();
    return true;
}

}  // namespace stipple
