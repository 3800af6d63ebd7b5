#pragma once

#include "stipple/codec.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace stipple {

/// In the order of the alternatives of `AttributeValues`; then those that the format has not, but
/// that tools over NumPy write: they are kept as doubles, exact up to 2^53; what that loses is
/// reported.
enum class PlyType : std::uint8_t {
    Int8,
    UInt8,
    Int16,
    UInt16,
    Int32,
    UInt32,
    Float32,
    Float64,
    Int64,
    UInt64
};

/// What values of a type in a file are kept as.
template <typename T>
using Kept = std::conditional_t<std::is_integral_v<T> && sizeof(T) == 8, double, T>;

/// Calls `f.template operator()<T>()` with the C++ type of `type`.
template <typename F>
decltype(auto) with_type(PlyType type, F&& f) {
    switch (type) {
        case PlyType::Int8:
            return f.template operator()<std::int8_t>();
        case PlyType::UInt8:
            return f.template operator()<std::uint8_t>();
        case PlyType::Int16:
            return f.template operator()<std::int16_t>();
        case PlyType::UInt16:
            return f.template operator()<std::uint16_t>();
        case PlyType::Int32:
            return f.template operator()<std::int32_t>();
        case PlyType::UInt32:
            return f.template operator()<std::uint32_t>();
        case PlyType::Float32:
            return f.template operator()<float>();
        case PlyType::Int64:
            return f.template operator()<std::int64_t>();
        case PlyType::UInt64:
            return f.template operator()<std::uint64_t>();
        case PlyType::Float64:
            break;
    }
    return f.template operator()<double>();
}

/// 1, 2, 4 or 8 bytes.
std::size_t size_of(PlyType type) noexcept;
/// `char`, `uchar`, `short`...: the first names the format had, which every reader knows.
std::string_view name_of(PlyType type) noexcept;
/// `ascii`, `binary_little_endian`, `binary_big_endian`.
std::string_view name_of(PlyEncoding encoding) noexcept;

struct PlyProperty {
    std::string name;
    PlyType type = PlyType::Float32;
    std::optional<PlyType> count_type;  ///< of a list: the type of its length

    bool is_list() const noexcept { return count_type.has_value(); }
};

struct PlyElement {
    std::string name;
    std::uint64_t count = 0;
    std::vector<PlyProperty> properties;

    bool has_list() const noexcept;
    /// Bytes of one in a binary body; with lists, when they are all empty.
    std::uint64_t least_bytes() const noexcept;
};

/// Where all of an element that begins at byte `at` ends at the earliest.
/// @throws Error(MalformedInput) where the file, of `file_bytes`, ends before.
std::uint64_t earliest_end(const PlyElement& element, PlyEncoding encoding, std::uint64_t at,
                           std::uint64_t file_bytes);

struct PlyHeader {
    PlyEncoding encoding = PlyEncoding::Ascii;
    std::vector<PlyElement> elements;
    std::vector<std::string> comments;       ///< of `comment` and `obj_info` lines
    std::vector<std::string> unknown_lines;  ///< `header line 15: 'bye'`
    std::size_t body = 0;                    ///< where the body starts in the file
};

/// Reads the header: LF, CRLF or CR at the end of lines, any blanks between words. Lines of no
/// known keyword are let pass before the first `element`, where they cannot change the layout, and
/// are an error after it.
/// @throws Error(MalformedInput), Error(UnsupportedFormat) naming the line.
PlyHeader parse_ply_header(std::span<const std::byte> file);

/// Whether the first bytes of a file hold all of its header.
bool holds_ply_header(std::span<const std::byte> head) noexcept;

}  // namespace stipple
