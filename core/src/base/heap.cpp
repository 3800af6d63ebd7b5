#include "stipple/heap.hpp"

#include <cstdint>
#include <cstdlib>

#if defined(__GLIBC__) && defined(__linux__)
#include <malloc.h>
#include <sys/mman.h>
#include <unistd.h>
#endif

namespace stipple {

void prefer_huge_heap() noexcept {
#if defined(__GLIBC__) && defined(MADV_HUGEPAGE)
    constexpr int kMiB = 1 << 20;
    constexpr std::uintptr_t kHugePage = 2 * kMiB;
    // What is smaller than the first comes from the heap, whose end stays when it is freed.
    ::mallopt(M_MMAP_THRESHOLD, 32 * kMiB);
    ::mallopt(M_TRIM_THRESHOLD, 512 * kMiB);
    ::mallopt(M_TOP_PAD, 33 * kMiB);
    const auto end_of_heap = [] { return reinterpret_cast<std::uintptr_t>(::sbrk(0)); };
    const std::uintptr_t begin = (end_of_heap() + kHugePage - 1) / kHugePage * kHugePage;
    void* volatile piece = std::malloc(31 * kMiB);  // volatile: or compilers leave both out
    std::free(piece);
    const std::uintptr_t end = end_of_heap();
    if (begin < end)  // advice: where it is not taken, small pages do
        ::madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
#endif
}

}  // namespace stipple
