#pragma once

#include "base/large_memory.hpp"
#include "stipple/point_cloud.hpp"

#include <algorithm>
#include <cstddef>
#include <type_traits>

namespace stipple {

/// Some points by their coordinates, and their numbers in the cloud; one array each, so that vector
/// code reads them as they lie.
template <bool kMutable>
struct BasicSampleSpan {
    template <typename T>
    using Pointer = std::conditional_t<kMutable, T*, const T*>;
    Pointer<float> x, y, z;
    Pointer<Index> index;
    std::size_t size = 0;

    BasicSampleSpan part(std::size_t begin, std::size_t end) const noexcept {
        return {x + begin, y + begin, z + begin, index + begin, end - begin};
    }
    Vec3f position(std::size_t i) const noexcept { return {x[i], y[i], z[i]}; }
    operator BasicSampleSpan<false>() const noexcept { return {x, y, z, index, size}; }
};
using SampleSpan = BasicSampleSpan<false>;
using MutableSampleSpan = BasicSampleSpan<true>;

inline void copy_samples(const SampleSpan& from, const MutableSampleSpan& to) {
    std::copy_n(from.x, from.size, to.x);
    std::copy_n(from.y, from.size, to.y);
    std::copy_n(from.z, from.size, to.z);
    std::copy_n(from.index, from.size, to.index);
}

constexpr std::size_t kSampleBytes = 3 * sizeof(float) + sizeof(Index);

/// Room for n samples in that many times `kSampleBytes`: all x, all y, all z, all indices.
inline MutableSampleSpan samples_in(void* memory, std::size_t n) noexcept {
    auto* const x = static_cast<float*>(memory);
    return {x, x + n, x + 2 * n, static_cast<Index*>(memory) + 3 * n, n};
}

/// Room for samples, not initialised: the first touch of memory costs as much as a level of the
/// tree.
class Samples {
public:
    explicit Samples(std::size_t n) : size_(n), memory_(n * kSampleBytes) {}

    std::size_t size() const noexcept { return size_; }
    MutableSampleSpan all() noexcept { return samples_in(memory_.data(), size_); }
    SampleSpan all() const noexcept { return const_cast<Samples*>(this)->all(); }

private:
    std::size_t size_;
    LargeMemory memory_;
};

}  // namespace stipple
