#pragma once

#include <cstddef>
#include <vector>

namespace stipple {

/// Neighbours by columns, each filled up to a multiple of four with zeros.
struct MlsColumns {
    const double *x, *y, *z;  ///< relative to the place that is projected
    const double* weight;     ///< 0 for what is filled up
    std::size_t size;         ///< without that

    static constexpr std::size_t kLanes = 4;
};

/// Sums over neighbours, with weights w and d their difference to a reference.
struct MlsMoments {
    double w, x, y, z;              ///< of w, and of w d
    double xx, xy, xz, yy, yz, zz;  ///< of w d d^T
};

/// The plane n . x = t, with e1 and e2 along it, and h.
struct MlsTrial {
    double n[3], e1[3], e2[3];
    double t, h;
};

/// First and second derivatives of Eq. 6 by (n . e1, n . e2, t), without a common factor of 2.
struct MlsDerivatives {
    double a, b, t, aa, ab, bb, at, bt, tt;
    double along_n;  ///< how fast the energy grows with the length of n
};

/// The inner loops of the MLS projection, for one instruction set. Every set gives the same bits:
/// the lanes of a sum are four, whatever the width of the machine's.
struct MlsKernels {
    const char* name;
    static constexpr std::size_t kMaxTerms = 15;

    /// Weights exp(-|p - c|^2 / h^2), times a factor that keeps the largest at 1.
    void (*weigh)(const MlsColumns& around, const double* c, double h, double* weight) noexcept;
    MlsMoments (*moments)(const MlsColumns& around, const double* reference) noexcept;
    MlsDerivatives (*derivatives)(const MlsColumns& around, const MlsTrial& plane) noexcept;
    /// The weighted least squares problem of a polynomial of `degree` in u = e1 . (p - q) / h, v =
    /// e2 . (p - q) / h with the heights n . (p - q), q = t n: the lower triangle of the matrix, by
    /// rows of `kMaxTerms`, and the right side. @return the largest height.
    double (*normal_equations)(const MlsColumns& around, const MlsTrial& plane, unsigned degree,
                               double* matrix, double* right) noexcept;
};

/// What this machine can run, the plainest first.
std::vector<MlsKernels> available_mls_kernels();

/// The quickest of them.
const MlsKernels& mls_kernels();

}  // namespace stipple
