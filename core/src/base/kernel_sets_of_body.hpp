// Included by the sources of kernels; see kernel_sets.hpp.

namespace plain {
#include STIPPLE_KERNELS_BODY
}

#if defined(STIPPLE_HAS_AVX2_KERNELS)
#pragma GCC push_options
#pragma GCC target("avx2")
#define STIPPLE_KERNELS_AVX2
namespace avx2 {
#include STIPPLE_KERNELS_BODY
}
#undef STIPPLE_KERNELS_AVX2
#pragma GCC pop_options
#else
namespace avx2 = plain;
#endif
