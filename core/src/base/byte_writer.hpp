#pragma once

#include "stipple/point_cloud.hpp"

#include <array>
#include <bit>
#include <cstddef>
#include <span>
#include <string_view>
#include <type_traits>
#include <vector>

namespace stipple {

static_assert(std::endian::native == std::endian::little, "numbers are written as they lie");

/// What binary files are made in.
struct ByteWriter {
    std::vector<std::byte> bytes;

    template <typename T>
    requires std::is_arithmetic_v<T> || std::is_enum_v<T>
    void put(T value) { put(std::bit_cast<std::array<std::byte, sizeof(T)>>(value)); }
    void put(std::span<const std::byte> more) {
        bytes.insert(bytes.end(), more.begin(), more.end());
    }
    void put(const Vec3d& v) {
        for (const double x : v) put(x);
    }
    void put(std::string_view text) { put(std::as_bytes(std::span(text))); }
    /// In a field of `size` bytes; what is longer is cut off.
    void put_padded(std::string_view text, std::size_t size) {
        text = text.substr(0, size);
        put(text);
        put_zeros(size - text.size());
    }
    void put_zeros(std::size_t count) { bytes.insert(bytes.end(), count, std::byte{0}); }
};

}  // namespace stipple
