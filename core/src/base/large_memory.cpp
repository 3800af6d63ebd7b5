#include "base/large_memory.hpp"

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#include <unistd.h>
#endif
#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace stipple {

namespace {

constexpr std::size_t kHugePage = std::size_t{2} << 20;
constexpr std::size_t kLine = 64;

/// A huge page is had for the price of 64 small ones, so that an end of as many becomes one, too.
std::size_t rounded(std::size_t bytes) noexcept {
    constexpr std::size_t kWorthIt = kHugePage / 8;
    if (bytes < kHugePage / 2 || bytes % kHugePage < kWorthIt) return bytes;
    return (bytes + kHugePage - 1) / kHugePage * kHugePage;
}

void* aligned(std::size_t bytes) {
    void* data = nullptr;
    if (::posix_memalign(&data, kLine, bytes) != 0) throw std::bad_alloc();
    return data;
}

#if defined(MADV_HUGEPAGE)

/// Pages of their own, not a hole that the allocator has: what is freed goes back to the system,
/// whatever else there is.
void* pages(std::size_t bytes) {
    void* const all = ::mmap(nullptr, bytes + kHugePage, PROT_READ | PROT_WRITE,
                             MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (all == MAP_FAILED) throw std::bad_alloc();
    const std::size_t skipped = -reinterpret_cast<std::uintptr_t>(all) % kHugePage;
    auto* const data = static_cast<std::byte*>(all) + skipped;
    if (skipped > 0) ::munmap(all, skipped);
    const auto size = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
    const std::size_t end = (bytes + size - 1) / size * size;
    if (skipped + end < bytes + kHugePage) ::munmap(data + end, kHugePage + bytes - skipped - end);
    // Advice: where it is not taken, small pages do, as they do for an end that fills no huge one.
    ::madvise(data, bytes / kHugePage * kHugePage, MADV_HUGEPAGE);
    return data;
}

void* memory_of(std::size_t bytes) {
    return bytes >= kHugePage ? pages(bytes) : aligned(bytes);
}
void give_back(void* data, std::size_t bytes) noexcept {
    if (bytes >= kHugePage)
        ::munmap(data, bytes);
    else
        std::free(data);
}

#else

void* memory_of(std::size_t bytes) {
    return aligned(bytes);
}
void give_back(void* data, std::size_t) noexcept {
    std::free(data);
}

#endif

class LargeMemoryResource : public std::pmr::memory_resource {
    void* do_allocate(std::size_t bytes, std::size_t alignment) override {
        if (alignment > kLine) throw std::bad_alloc();
        return memory_of(rounded(bytes));
    }
    void do_deallocate(void* data, std::size_t bytes, std::size_t) override {
        give_back(data, rounded(bytes));
    }
    bool do_is_equal(const memory_resource& other) const noexcept override {
        return this == &other;
    }
};

}  // namespace

LargeMemory::LargeMemory(std::size_t bytes)
    : data_(memory_of(rounded(bytes))), bytes_(rounded(bytes)) {}

std::pmr::memory_resource& large_memory_resource() noexcept {
    static LargeMemoryResource resource;
    return resource;
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
    if (data_ != nullptr) give_back(data_, bytes_);
}

void prefer_huge_pages(void* data, std::size_t bytes) noexcept {
#if defined(MADV_HUGEPAGE)
    constexpr std::size_t kWorthIt = 2 * kHugePage;
    if (bytes < kWorthIt) return;
    // What lies beside it is the same allocator's, and shares the huge pages of the ends.
    const auto address = reinterpret_cast<std::uintptr_t>(data);
    const std::size_t before = address % kHugePage;
    ::madvise(static_cast<std::byte*>(data) - before,
              (before + bytes + kHugePage - 1) / kHugePage * kHugePage, MADV_HUGEPAGE);
#else
    static_cast<void>(data), static_cast<void>(bytes);
#endif
}

void return_pages(void* data, std::size_t bytes) noexcept {
#if defined(MADV_DONTNEED)
    const auto page = static_cast<std::uintptr_t>(::sysconf(_SC_PAGESIZE));
    const auto address = reinterpret_cast<std::uintptr_t>(data);
    const std::uintptr_t begin = (address + page - 1) / page * page,
                         end = (address + bytes) / page * page;
    if (begin < end)
        ::madvise(static_cast<std::byte*>(data) + (begin - address), end - begin, MADV_DONTNEED);
#else
    static_cast<void>(data), static_cast<void>(bytes);
#endif
}

void return_freed_memory() noexcept {
#if defined(__GLIBC__)
    ::malloc_trim(0);
#endif
}

}  // namespace stipple
