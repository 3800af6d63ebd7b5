#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

struct LocalAnalysisOptions {
    unsigned k = 16;  ///< size of a neighbourhood N_p, 3..64; 0: chosen for each point from 8, 12,
                      ///< 16, 24, 32, 48 and 64, to minimise the error of its normal from noise and
                      ///< curvature together (Mitra, Nguyen and Guibas 2004)
    bool normals = true;
    bool variation = true;
    bool density = false;
    bool anisotropy = false;
};

/// Local surface properties (§2, §2.1) of each of N points; what was not requested is empty. Every
/// value is finite, even for degenerate neighbourhoods.
struct LocalAnalysis {
    std::vector<Vec3f>
        normals;  ///< unit v_0 of Eq. 4, of arbitrary sign (`orient_normals`). For collinear
                  ///< points, any direction across the line; for coincident points, any
    std::vector<float> variation;  ///< sigma_n of Eq. 5, in [0, 1/3]; 0 on a plane or a line, and
                                   ///< if all neighbours coincide
    std::vector<float> density;  ///< rho = k / r^2 (§2), per squared input unit, r the distance of
                                 ///< the k-th neighbour; the largest float if r is 0
    std::vector<float>
        anisotropy;  ///< (lambda_2 - lambda_1) / lambda_2: 0 if the neighbours are spread evenly
                     ///< about the point or coincide, 1 if they lie along a line
};

/// Density, covariance, normal and surface variation of the neighbourhood of every point: its k
/// nearest neighbours (all others if there are fewer) and itself, around their centroid (Eq. 1).
///
/// A single point has the normal z and otherwise zeros. Positions must be finite (`clean`).
/// @throws Error(InvalidArgument) for k = 1, 2 or above 64.
///
/// Expected O(N k) for points on surfaces, parallel, the same bits for any number of threads; about
/// 36 bytes per point while it runs. Choosing k costs about three times as much as k = 16.
LocalAnalysis analyze_locally(std::span<const Vec3f> points,
                              const LocalAnalysisOptions& options = {},
                              const RunContext& context = {});

/// Surface variation of a neighbourhood (§2.1, Eq. 5): λ0 / (λ0 + λ1 + λ2), with λ0 ≤ λ1 ≤ λ2.
///
/// @param eigenvalues  ascending, of the 3×3 covariance of Eq. 1 (any positive scale).
/// @return  in [0, 1/3]; 0 on a plane, 1/3 when isotropic, 0 when all points coincide.
double surface_variation(const Vec3d& eigenvalues) noexcept;

}  // namespace stipple
