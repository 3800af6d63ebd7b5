#pragma once

#include "neighbors/nearest_kernels.hpp"

#include <cstdint>
#include <vector>

namespace stipple {

/// Sums over points of d and of the products of its coordinates, with d their difference to a
/// reference.
struct alignas(32) Moments {
    double sum[4] = {};       ///< x y z
    double squares[4] = {};   ///< xx yy zz
    double products[4] = {};  ///< xy yz zx
};

/// Eight symmetric matrices, and what is asked of them.
struct alignas(32) EigenProblems {
    double xx[8], yy[8], zz[8], xy[8], yz[8], zx[8];
    double low[8], middle[8], high[8];  ///< eigenvalues, ascending
    double x[8], y[8], z[8];            ///< unit eigenvector of the lowest
};

/// The inner loops of local analysis, for one instruction set. Every set gives the same bits.
struct CovarianceKernels {
    const char* name;

    /// Adds the candidates at `slots`, one after the other, relative to `reference` (x y z).
    void (*add_moments)(const Candidates& candidates, const std::uint32_t* slots,
                        std::uint32_t count, const float* reference, Moments& moments) noexcept;

    /// Jacobi's rotations on all eight at once: as exact where eigenvalues are close or equal as
    /// elsewhere, and the eigenvector is always of unit length. Finite entries of at most 1e150.
    void (*solve)(EigenProblems& problems) noexcept;
};

/// What this machine can run, the plainest first.
std::vector<CovarianceKernels> available_covariance_kernels();

/// The quickest of them.
const CovarianceKernels& covariance_kernels();

}  // namespace stipple
