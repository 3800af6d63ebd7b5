#include "covariance_kernels.hpp"

#include <cmath>
#include <cstdint>

// GCC compiles the same lines for another instruction set between these pragmas; where that is not
// to be had, the plain form serves.
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__)
#define STIPPLE_HAS_AVX2_KERNELS 1
#include <immintrin.h>
#endif

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored \
    "-Wpsabi"  // vectors of 32 bytes are passed between functions of this file only
#endif

namespace stipple {

namespace {

namespace plain {
#include "covariance_kernels_body.hpp"
}

#if defined(STIPPLE_HAS_AVX2_KERNELS)
#pragma GCC push_options
#pragma GCC target("avx2")
#define STIPPLE_KERNELS_AVX2
namespace avx2 {
#include "covariance_kernels_body.hpp"
}
#undef STIPPLE_KERNELS_AVX2
#pragma GCC pop_options
#endif

}  // namespace

std::vector<CovarianceKernels> available_covariance_kernels() {
    std::vector<CovarianceKernels> kernels = {{"plain", plain::add_moments, plain::solve}};
#if defined(STIPPLE_HAS_AVX2_KERNELS)
    if (__builtin_cpu_supports("avx2")) kernels.push_back({"avx2", avx2::add_moments, avx2::solve});
#endif
    return kernels;
}

const CovarianceKernels& covariance_kernels() {
    static const CovarianceKernels best = available_covariance_kernels().back();
    return best;
}

}  // namespace stipple
