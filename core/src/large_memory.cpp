#include "large_memory.hpp"

#include <cstdlib>
#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif
#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace stipple {

namespace {

constexpr std::size_t kHugePage = std::size_t{2} << 20;
constexpr std::size_t kLine = 64;

}  // namespace

LargeMemory::LargeMemory(std::size_t bytes) : bytes_(bytes) {
    if (::posix_memalign(&data_, bytes >= kHugePage ? kHugePage : kLine, bytes) != 0)
        throw std::bad_alloc();
#if defined(MADV_HUGEPAGE)
    // Advice: where it is not taken, small pages do, as they do for the end that fills no huge one.
    if (bytes >= kHugePage) ::madvise(data_, bytes / kHugePage * kHugePage, MADV_HUGEPAGE);
#endif
}

void LargeMemory::shrink(std::size_t bytes) noexcept {
#if defined(MADV_DONTNEED)
    if (bytes_ < kHugePage) return;
    const std::size_t kept = (bytes + kHugePage - 1) / kHugePage * kHugePage;
    const std::size_t end = bytes_ / kHugePage * kHugePage;
    if (kept < end) ::madvise(static_cast<std::byte*>(data_) + kept, end - kept, MADV_DONTNEED);
#else
    static_cast<void>(bytes);
#endif
}

LargeMemory::~LargeMemory() {
    std::free(data_);
}

void return_freed_memory() noexcept {
#if defined(__GLIBC__)
    ::malloc_trim(0);
#endif
}

}  // namespace stipple
