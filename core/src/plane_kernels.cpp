#include "plane_kernels.hpp"

// GCC compiles the same lines for another instruction set between these pragmas; where that is not
// to be had, the plain form serves.
#if defined(__SSE2__)
#include <immintrin.h>
#endif
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__)
#define STIPPLE_HAS_AVX2_KERNELS 1
#endif

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored \
    "-Wpsabi"  // wide vectors are passed between functions of this file only
#endif

namespace stipple {

namespace {

namespace plain {
#include "plane_kernels_body.hpp"
}

#if defined(STIPPLE_HAS_AVX2_KERNELS)
#pragma GCC push_options
#pragma GCC target("avx2")
#define STIPPLE_KERNELS_AVX2
namespace avx2 {
#include "plane_kernels_body.hpp"
}
#undef STIPPLE_KERNELS_AVX2
#pragma GCC pop_options
#endif

}  // namespace

std::vector<PlaneKernel> available_plane_kernels() {
    std::vector<PlaneKernel> kernels = {{"plain", plain::run}};
#if defined(STIPPLE_HAS_AVX2_KERNELS)
    if (__builtin_cpu_supports("avx2")) kernels.push_back({"avx2", avx2::run});
#endif
    return kernels;
}

const PlaneKernel& plane_kernel() {
    static const PlaneKernel best = available_plane_kernels().back();
    return best;
}

}  // namespace stipple
