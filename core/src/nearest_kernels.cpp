#include "nearest_kernels.hpp"

#include "float4.hpp"

#include <climits>
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
#include "nearest_kernels_body.hpp"
}

#if defined(STIPPLE_HAS_AVX2_KERNELS)
/// For each mask of eight lanes the numbers of the chosen ones, in order, a byte each.
struct PackedLanes {
    std::uint64_t of[256];
};
constexpr PackedLanes kPackedLaneTable = [] {
    PackedLanes table{};
    for (unsigned mask = 0; mask < 256; ++mask) {
        unsigned to = 0;
        for (std::uint64_t lane = 0; lane < 8; ++lane) {
            if ((mask >> lane & 1U) != 0) table.of[mask] |= lane << (8 * to++);
        }
    }
    return table;
}();
constexpr const std::uint64_t* kPackedLanes = kPackedLaneTable.of;

#pragma GCC push_options
#pragma GCC target("avx2")
#define STIPPLE_KERNELS_AVX2
namespace avx2 {
#include "nearest_kernels_body.hpp"
}
#undef STIPPLE_KERNELS_AVX2
#pragma GCC pop_options
#endif

}  // namespace

std::vector<NearestKernels> available_nearest_kernels() {
    std::vector<NearestKernels> kernels = {{"plain", plain::gather, plain::choose, plain::rank}};
#if defined(STIPPLE_HAS_AVX2_KERNELS)
    if (__builtin_cpu_supports("avx2"))
        kernels.push_back({"avx2", avx2::gather, avx2::choose, avx2::rank});
#endif
    return kernels;
}

const NearestKernels& nearest_kernels() {
    static const NearestKernels best = available_nearest_kernels().back();
    return best;
}

}  // namespace stipple
