#pragma once

#include "analysis/mls_kernels.hpp"
#include "stipple/point_cloud.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stipple {

/// Points around a position r, and their weights, for the fits of §2.2. Kept between fits, so that
/// it allocates only while it grows.
struct MlsNeighborhood {
    std::vector<double> x, y, z;  ///< relative to r; filled up with zeros for vector code
    std::vector<double> weight;   ///< of the last fit, up to a common factor

    std::size_t size() const noexcept { return size_; }
    void resize(std::size_t n);
    MlsColumns columns() const noexcept {
        return {x.data(), y.data(), z.data(), weight.data(), size_};
    }

private:
    std::size_t size_ = 0;
};

/// H = { x | n . x = t }, x relative to r. `q = t n` is the projection of r.
struct MlsPlane {
    enum class Kind : std::uint8_t {
        Minimum,   ///< of Eq. 6
        Weighted,  ///< no minimum found: the plane of least squares with the weights held fast
        Line,      ///< the neighbours lie on a line: q is its point nearest to r, n across it
        Point,     ///< the neighbours coincide: q is their place
    };
    Vec3d n = Vec3d::UnitZ();
    Vec3d q = Vec3d::Zero();
    double t = 0;
    Kind kind = Kind::Minimum;
};

/// Minimises Eq. 6 over n and t by Newton's method from the plane of weighted least squares; leaves
/// the weights centred at q behind.
MlsPlane fit_plane(MlsNeighborhood& around, double h, unsigned max_iterations, double tolerance);

/// The plane of weighted least squares with the weights centred at r, which it leaves behind: not
/// of Eq. 6, but with the same weights for every plane.
MlsPlane fit_weighted_plane(MlsNeighborhood& around, double h);

/// A polynomial over a plane at its origin q: height and normal.
struct MlsHeight {
    double height = 0;
    Vec3d normal = Vec3d::UnitZ();
};

/// Weighted least squares of `degree` 0..4 with the weights that are there, over the plane through
/// `q` across `n`.
MlsHeight fit_polynomial(const MlsNeighborhood& around, const Vec3d& n, const Vec3d& q, double h,
                         unsigned degree);

}  // namespace stipple
