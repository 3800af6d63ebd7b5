#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace stipple {

struct MlsOptions {
    unsigned degree = 2;  ///< of the polynomial g(u, v): 0 (the plane itself) to 4
    unsigned k = 20;      ///< size of a neighbourhood, 6..64; for the adaptive h only
    std::optional<double>
        h{};  ///< fixed scale, input units, > 0: all points within 3 h contribute; absent: adaptive
              ///< h = r / 3, r the radius of the k nearest (§2.2)
    bool fixed_point = false;  ///< projects repeatedly until the point no longer moves
    unsigned max_iterations =
        30;                   ///< for the minimisation of the plane, and for the fixed point; >= 1
    double tolerance = 1e-4;  ///< a step shorter than this fraction of h ends either; in (0, 1)
};

enum class MlsStatus : std::uint8_t {
    Converged,
    NotConverged,  ///< Eq. 6 has no minimum nearby, or `max_iterations` were not enough: the result
                   ///< uses the plane for fixed weights, or the last iterate
    Degenerate,    ///< the neighbours define no plane: the nearest point of their line, or their
                   ///< common place
    TooFar,        ///< no weight reaches the point (fixed h): it is returned unchanged
};

struct MlsProjection {
    Vec3d point;   ///< Psi(P, r), relative to the origin of the cloud; never NaN
    Vec3d normal;  ///< of the surface there, unit, of arbitrary sign
    MlsStatus status = MlsStatus::Converged;
};

/// The moving least squares surface of a point cloud (§2.2): { x | Psi(P, x) = x }.
///
/// Psi(P, r) has two steps. The plane H = { x | x . n = D } minimises Eq. 6, where the weights are
/// centred at q, the projection of r onto H, and so move with n and D. Over it a polynomial g(u, v)
/// of `degree` is fitted to the same points with the same weights; Psi(P, r) = q + g(0, 0) n.
/// Neighbours and the adaptive h are those of r.
///
/// The degree is lowered for a point with fewer neighbours than coefficients, or if g(0, 0) would
/// lie beyond one and a half times the heights of all neighbours. Terms that the neighbours do not
/// determine are dropped, higher ones first.
///
/// On a sphere of curvature kappa, a plane or a linear g lies inside by about h^2 kappa / 2;
/// degrees 2 and 3 by an order h^2 less.
class MlsSurface {
public:
    /// Holds a copy of the points: 32 bytes each. Needs at least one point, all finite (`clean`).
    /// @throws Error(InvalidArgument) for no points or an option out of range.
    ///
    /// O(N log N), parallel.
    MlsSurface(std::span<const Vec3f> points, const MlsOptions& options,
               const RunContext& context = {});
    ~MlsSurface();
    MlsSurface(MlsSurface&&) noexcept;
    MlsSurface& operator=(MlsSurface&&) noexcept;

    /// Psi(P, r) for a finite r. For any thread.
    MlsProjection project(const Vec3d& r) const;

    /// Projects all points, in parallel; 56 bytes each. 1.5 to 2 us each for k = 20 and a degree up
    /// to 2, a third of it for the search; fastest if consecutive points are close together.
    std::vector<MlsProjection> project(std::span<const Vec3f> points,
                                       const RunContext& context = {}) const;

private:
    struct Implementation;
    std::unique_ptr<const Implementation> implementation_;
};

}  // namespace stipple
