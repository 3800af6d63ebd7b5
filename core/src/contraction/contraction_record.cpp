#include "contraction/contraction_record.hpp"

#include <cmath>
#include <limits>

namespace stipple {

namespace {

/// Four records, one in each lane.
struct Lanes {
    Float4 px, py, pz, xx, xy, xz, yy, yz, zz, x, y, z, c;

    explicit Lanes(const std::array<const ContractionRecord*, 4>& records) {
        transpose(records, 0, px, py, pz, xx);
        transpose(records, 4, xy, xz, yy, yz);
        transpose(records, 8, zz, x, y, z);
        c = Float4{records[0]->quadric.c, records[1]->quadric.c, records[2]->quadric.c,
                   records[3]->quadric.c};
    }

private:
    /// Takes four floats from each record, the one at `first` and those behind it.
    static void transpose(const std::array<const ContractionRecord*, 4>& records, std::size_t first,
                          Float4& a, Float4& b, Float4& c, Float4& d) {
        const auto row = [&](std::size_t i) {
            Float4 v;
            __builtin_memcpy(&v, reinterpret_cast<const char*>(records[i]) + first * sizeof(float),
                             sizeof v);
            return v;
        };
        const Float4 r0 = row(0), r1 = row(1), r2 = row(2), r3 = row(3);
        const Float4 low01 = __builtin_shufflevector(r0, r1, 0, 4, 1, 5),
                     high01 = __builtin_shufflevector(r0, r1, 2, 6, 3, 7),
                     low23 = __builtin_shufflevector(r2, r3, 0, 4, 1, 5),
                     high23 = __builtin_shufflevector(r2, r3, 2, 6, 3, 7);
        a = __builtin_shufflevector(low01, low23, 0, 1, 4, 5);
        b = __builtin_shufflevector(low01, low23, 2, 3, 6, 7);
        c = __builtin_shufflevector(high01, high23, 0, 1, 4, 5);
        d = __builtin_shufflevector(high01, high23, 2, 3, 6, 7);
    }
};

}  // namespace

JoinedSamples join(const ContractionRecord& a, const ContractionRecord& b, Placement placement) {
    const Vec3d d = (b.position - a.position).cast<double>();
    JoinedSamples joined{Quadric(a.quadric) + referred_to(Quadric(b.quadric), -d), Vec3d::Zero()};
    if (placement == Placement::EndPoint) {
        if (value(joined.quadric, d) < joined.quadric.c) joined.offset = d;
        return joined;
    }
    const Vec3d middle = 0.5 * d;
    Vec3d y = middle;
    if (minimiser(joined.quadric, y)) {
        const double away_sq = (y - middle).squaredNorm(), limit_sq = d.squaredNorm();
        if (away_sq > limit_sq) y = middle + (y - middle) * std::sqrt(limit_sq / away_sq);
    }
    joined.offset = y;
    return joined;
}

Float4 costs_of_joining(const std::array<const ContractionRecord*, 4>& a,
                        const std::array<const ContractionRecord*, 4>& b, Placement placement) {
    const Lanes p(a), q(b);
    const Float4 dx = q.px - p.px, dy = q.py - p.py, dz = q.pz - p.pz;
    // The second's quadric relative to the first's position: A, b - A d and d'Ad - 2 b'd + c.
    const Float4 gx = q.xx * dx + q.xy * dy + q.xz * dz, gy = q.xy * dx + q.yy * dy + q.yz * dz,
                 gz = q.xz * dx + q.yz * dy + q.zz * dz;
    const Float4 xx = p.xx + q.xx, xy = p.xy + q.xy, xz = p.xz + q.xz, yy = p.yy + q.yy,
                 yz = p.yz + q.yz, zz = p.zz + q.zz;
    const Float4 x = p.x + (q.x - gx), y = p.y + (q.y - gy), z = p.z + (q.z - gz);
    // The value at the first's position, less what both cost already.
    const Float4 added_there = dx * (gx - 2 * q.x) + dy * (gy - 2 * q.y) + dz * (gz - 2 * q.z);
    const auto added_at = [&](Float4 u, Float4 v, Float4 w) {
        return added_there + u * (xx * u + 2 * (xy * v + xz * w + x)) +
               v * (yy * v + 2 * (yz * w + y)) + w * (zz * w + 2 * z);
    };
    const Float4 distance_sq = dx * dx + dy * dy + dz * dz;
    Float4 added;
    if (placement == Placement::EndPoint) {
        const Float4 at_b = added_at(dx, dy, dz);
        added = at_b < added_there ? at_b : added_there;
    } else {
        // Cholesky's method, as in `minimiser`.
        const Float4 least = 1e-6F * (xx + yy + zz);
        const Float4 rx = 1 / xx, lyx = xy * rx, lzx = xz * rx;
        const Float4 d2 = yy - lyx * xy, r2 = 1 / d2, e2 = yz - lyx * xz, lzy = e2 * r2;
        const Float4 d3 = zz - lzx * xz - lzy * e2;
        const Float4 v2 = lyx * x - y, v3 = lzx * x - z - lzy * v2;
        Float4 w = v3 / d3, v = v2 * r2 - lzy * w, u = -x * rx - lyx * v - lzx * w;
        const Float4 mx = 0.5F * dx, my = 0.5F * dy, mz = 0.5F * dz;
        const Float4 away_sq = (u - mx) * (u - mx) + (v - my) * (v - my) + (w - mz) * (w - mz);
        Float4 part = away_sq > distance_sq ? square_root(distance_sq / away_sq) : splat(1);
        const auto regular = (xx > least) & (d2 > least) & (d3 > least);
        part = regular ? part : splat(0);
        u = regular ? mx + part * (u - mx) : mx;
        v = regular ? my + part * (v - my) : my;
        w = regular ? mz + part * (w - mz) : mz;
        added = added_at(u, v, w);
    }
    added = added > 0 ? added : splat(0);
    const Float4 cost = added * square_root(distance_sq);
    const Float4 most = splat(std::numeric_limits<float>::max());
    return cost < most ? cost : most;
}

}  // namespace stipple
