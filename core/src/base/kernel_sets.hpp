#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

// Kernels are inner loops that are compiled for several instruction sets, from one text, so that
// they give the same bits. A source includes this, defines STIPPLE_KERNELS_BODY as the file with
// the text, and includes kernel_sets_of_body.hpp in an unnamed namespace: that makes the namespaces
// `plain` and `avx2`; within the latter STIPPLE_KERNELS_AVX2 is defined. The text must use no
// inline function or template of another file: of their copies the linker might keep the one that
// not every machine can run.

// GCC compiles the same lines for another instruction set between pragmas; where that is not to be
// had, the plain form serves.
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__)
#define STIPPLE_HAS_AVX2_KERNELS 1
#endif
#if defined(__SSE2__)
#include <immintrin.h>
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored \
    "-Wpsabi"  // wide vectors are passed between functions of one file only
#endif

namespace stipple {

/// For each mask of eight lanes the numbers of the chosen ones and then of the others, in order, a
/// byte each.
struct PackedLanes {
    std::uint64_t of[256];
};
inline constexpr PackedLanes kPackedLanes = [] {
    PackedLanes table{};
    for (unsigned mask = 0; mask < 256; ++mask) {
        unsigned to = 0;
        for (const unsigned part : {mask, ~mask}) {
            for (std::uint64_t lane = 0; lane < 8; ++lane) {
                if ((part >> lane & 1U) != 0) table.of[mask] |= lane << (8 * to++);
            }
        }
    }
    return table;
}();

/// As long as one lives, everything computes with the plain kernels: for tests, which compare what
/// comes out with what the quickest give. One at a time, and none made or destroyed while something
/// computes.
class PlainKernelsOnly {
public:
    PlainKernelsOnly() noexcept { wanted_.store(true, std::memory_order_relaxed); }
    ~PlainKernelsOnly() { wanted_.store(false, std::memory_order_relaxed); }
    PlainKernelsOnly(const PlainKernelsOnly&) = delete;
    PlainKernelsOnly& operator=(const PlainKernelsOnly&) = delete;

    static bool wanted() noexcept { return wanted_.load(std::memory_order_relaxed); }

private:
    inline static std::atomic<bool> wanted_ = false;
};

/// What this machine can run, the plainest first: `plain`, and `avx2` where it has that.
template <typename Kernels>
std::vector<Kernels> with_avx2(const Kernels& plain, const Kernels& avx2) {
#if defined(STIPPLE_HAS_AVX2_KERNELS)
    if (__builtin_cpu_supports("avx2")) return {plain, avx2};
#endif
    (void)avx2;
    return {plain};
}

/// The quickest of kernels that stand in order.
template <typename Kernels>
const Kernels& quickest(const std::vector<Kernels>& available) noexcept {
    return PlainKernelsOnly::wanted() ? available.front() : available.back();
}

}  // namespace stipple
