#pragma once

#include <cstddef>
#include <memory_resource>

namespace stipple {

/// Memory that is written once and read a few times, as working arrays of an algorithm are. On
/// Linux in huge pages where the system lets it choose them: with small ones, a first touch costs
/// more than what is then done with the bytes.
class LargeMemory {
public:
    /// Not initialised. @throws std::bad_alloc.
    explicit LargeMemory(std::size_t bytes);
    ~LargeMemory();
    LargeMemory(const LargeMemory&) = delete;
    LargeMemory& operator=(const LargeMemory&) = delete;

    void* data() const noexcept { return data_; }

    /// Gives back what lies behind the first `bytes`, as far as whole pages go; the rest stays
    /// where it is.
    void shrink(std::size_t bytes) noexcept;

private:
    void* data_ = nullptr;
    std::size_t bytes_ = 0;
};

/// Memory of that kind for standard containers.
std::pmr::memory_resource& large_memory_resource() noexcept;

/// Asks for huge pages for the whole ones within new memory, not touched yet: for arrays that are
/// had from elsewhere.
void prefer_huge_pages(void* data, std::size_t bytes) noexcept;

/// Gives the system back the whole pages within memory that no longer holds anything but is not
/// freed; they come again, cleared, when they are touched.
void return_pages(void* data, std::size_t bytes) noexcept;

/// Gives the system back what was freed but kept for later by the allocator: for between a phase of
/// an algorithm that needs much memory and the next.
void return_freed_memory() noexcept;

}  // namespace stipple
