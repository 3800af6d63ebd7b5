#include "cluster_kernels.hpp"

#include "float4.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <type_traits>

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
#include "cluster_kernels_body.hpp"
}

#if defined(STIPPLE_HAS_AVX2_KERNELS)
/// For each mask of eight lanes the numbers of the chosen ones and then of the others, in order, a
/// byte each.
constexpr auto kPackedLanes = [] {
    std::array<std::uint64_t, 256> table{};
    for (unsigned mask = 0; mask < 256; ++mask) {
        unsigned to = 0;
        for (const unsigned part : {mask, ~mask}) {
            for (std::uint64_t lane = 0; lane < 8; ++lane) {
                if ((part >> lane & 1U) != 0) table[mask] |= lane << (8 * to++);
            }
        }
    }
    return table;
}();

#pragma GCC push_options
#pragma GCC target("avx2")
#define STIPPLE_KERNELS_AVX2
namespace avx2 {
#include "cluster_kernels_body.hpp"
}
#undef STIPPLE_KERNELS_AVX2
#pragma GCC pop_options
#endif

}  // namespace

std::vector<ClusterKernels> available_cluster_kernels() {
    std::vector<ClusterKernels> kernels = {{"plain", plain::partition, plain::sums, plain::spreads,
                                            plain::nearby, plain::box, plain::count}};
#if defined(STIPPLE_HAS_AVX2_KERNELS)
    if (__builtin_cpu_supports("avx2")) {
        kernels.push_back({"avx2", avx2::partition, avx2::sums, avx2::spreads, avx2::nearby,
                           avx2::box, avx2::count});
    }
#endif
    return kernels;
}

const ClusterKernels& cluster_kernels() {
    static const ClusterKernels best = available_cluster_kernels().back();
    return best;
}

}  // namespace stipple
