#include "large_memory.hpp"

#include <cstdlib>
#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace stipple {

LargeMemory::LargeMemory(std::size_t bytes) {
    constexpr std::size_t kHugePage = std::size_t{2} << 20;
    constexpr std::size_t kLine = 64;
    if (::posix_memalign(&data_, bytes >= kHugePage ? kHugePage : kLine, bytes) != 0) throw std::bad_alloc();
#if defined(MADV_HUGEPAGE)
    // Advice: where it is not taken, small pages do, as they do for the end that fills no huge one.
    if (bytes >= kHugePage) ::madvise(data_, bytes / kHugePage * kHugePage, MADV_HUGEPAGE);
#endif
}

LargeMemory::~LargeMemory() {
    std::free(data_);
}

}  // namespace stipple
