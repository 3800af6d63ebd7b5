#pragma once

#include <cstddef>
#include <memory_resource>
#include <type_traits>
#include <utility>

namespace stipple {

/// Memory that is written once and read a few times, as working arrays of an algorithm are. On
/// Linux in huge pages where the system lets it choose them: with small ones, a first touch costs
/// more than what is then done with the bytes.
class LargeMemory {
public:
    LargeMemory() = default;
    /// Not initialised. @throws std::bad_alloc.
    explicit LargeMemory(std::size_t bytes);
    ~LargeMemory();
    LargeMemory(LargeMemory&& other) noexcept
        : data_(std::exchange(other.data_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}
    LargeMemory& operator=(LargeMemory&& other) noexcept {
        std::swap(data_, other.data_);
        std::swap(bytes_, other.bytes_);
        return *this;
    }

    void* data() const noexcept { return data_; }

    /// Gives back what lies behind the first `bytes`, as far as whole pages go; the rest stays
    /// where it is.
    void shrink(std::size_t bytes) noexcept;

private:
    void* data_ = nullptr;
    std::size_t bytes_ = 0;
};

/// An array in such memory, whose values are not there before they are written.
template <typename T>
class LargeArray {
    static_assert(std::is_trivially_default_constructible_v<T> &&
                  std::is_trivially_destructible_v<T>);

public:
    LargeArray() = default;
    /// @throws std::bad_alloc.
    explicit LargeArray(std::size_t n) : size_(n), memory_(n * sizeof(T)) {}
    LargeArray(LargeArray&& other) noexcept
        : size_(std::exchange(other.size_, 0)), memory_(std::move(other.memory_)) {}
    LargeArray& operator=(LargeArray&& other) noexcept {
        std::swap(size_, other.size_);
        memory_ = std::move(other.memory_);
        return *this;
    }

    std::size_t size() const noexcept { return size_; }
    T* data() noexcept { return static_cast<T*>(memory_.data()); }
    const T* data() const noexcept { return static_cast<const T*>(memory_.data()); }
    T& operator[](std::size_t i) noexcept { return data()[i]; }
    const T& operator[](std::size_t i) const noexcept { return data()[i]; }
    T* begin() noexcept { return data(); }
    T* end() noexcept { return data() + size_; }
    const T* begin() const noexcept { return data(); }
    const T* end() const noexcept { return data() + size_; }

private:
    std::size_t size_ = 0;
    LargeMemory memory_;
};

/// Memory of that kind for standard containers.
std::pmr::memory_resource& large_memory_resource() noexcept;

/// Asks for huge pages for new memory, not touched yet, and for what shares the first and the last
/// of them: for arrays that are had from elsewhere.
void prefer_huge_pages(void* data, std::size_t bytes) noexcept;

/// Gives the system back the whole pages within memory that no longer holds anything but is not
/// freed; they come again, cleared, when they are touched.
void return_pages(void* data, std::size_t bytes) noexcept;

/// Gives the system back what was freed but kept for later by the allocator: for between a phase of
/// an algorithm that needs much memory and the next.
void return_freed_memory() noexcept;

}  // namespace stipple
