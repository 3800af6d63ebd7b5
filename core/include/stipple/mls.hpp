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
    unsigned k =
        20;  ///< neighbours that may contribute, 6..64; more than degree 3 and 4 have coefficients
    std::optional<double> h{};  ///< fixed scale, input units; absent: adaptive, h = r / 3 (§2.2)
    unsigned max_iterations = 30;
    double tolerance = 1e-4;  ///< a step shorter than this part of h ends the iteration
};

enum class MlsStatus : std::uint8_t {
    Converged,
    NotConverged,  ///< `max_iterations` were not enough: the best iterate is given
    Degenerate,  ///< the neighbours carry no plane (a line, a point, too few): the nearest of what
                 ///< they carry
    TooFar,      ///< no weight reaches the point (fixed h): it is given back as it came
};

struct MlsProjection {
    Vec3d point;   ///< Psi(P, r), relative to the origin of the cloud; never NaN for a finite r
    Vec3d normal;  ///< of the surface there, unit; sign any
    MlsStatus status = MlsStatus::Converged;
};

/// The moving least squares surface of a point cloud (§2.2): { x | Psi(P, x) = x }.
class MlsSurface {
public:
    MlsSurface(std::span<const Vec3f> points, const MlsOptions& options,
               const RunContext& context = {});
    ~MlsSurface();
    MlsSurface(MlsSurface&&) noexcept;
    MlsSurface& operator=(MlsSurface&&) noexcept;

    /// Psi(P, r): the plane H that minimises Eq. 6 over n and D, then the polynomial over it.
    /// Thread-safe.
    MlsProjection project(const Vec3d& r) const;

    /// All of them, in parallel.
    std::vector<MlsProjection> project(std::span<const Vec3f> points,
                                       const RunContext& context = {}) const;

private:
    struct Implementation;
    std::unique_ptr<const Implementation> implementation_;
};

}  // namespace stipple
