#pragma once

#include "base/in_quotes.hpp"
#include "codec/ply_header.hpp"
#include "codec/ply_number.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <bit>
#include <concepts>
#include <cstring>
#include <limits>
#include <string>
#include <utility>

namespace stipple {

/// Where a cursor is, for messages: `vertex 12, property x`.
struct PlyPlace {
    const PlyElement* element = nullptr;
    std::uint64_t row = 0;

    std::string describe(const PlyProperty* property) const {
        std::string text = element->name + " " + std::to_string(row);
        if (property != nullptr) text += ", property " + property->name;
        return text;
    }
};

/// Reads a body value by value, and never past its end. Both cursors have the same members, so that
/// what walks a body is written once.
template <bool kSwap>
class BinaryCursor {
public:
    PlyPlace place;

    BinaryCursor(std::span<const std::byte> file, std::size_t from)
        : file_(file.data()), here_(file.data() + from), end_(file.data() + file.size()) {}

    const std::byte* position() const noexcept { return here_; }
    std::size_t remaining() const noexcept { return static_cast<std::size_t>(end_ - here_); }
    void advance(std::size_t bytes) noexcept { here_ += bytes; }

    template <typename T>
    static T load(const std::byte* from) noexcept {
        if constexpr (kSwap && sizeof(T) > 1) {
            std::array<std::byte, sizeof(T)> bytes;
            std::reverse_copy(from, from + sizeof(T), bytes.begin());
            return std::bit_cast<T>(bytes);
        } else {
            T value;
            std::memcpy(&value, from, sizeof(T));
            return value;
        }
    }

    template <typename T>
    T read(const PlyProperty& property) {
        if (remaining() < sizeof(T)) fail_at_end(&property);
        const T value = load<T>(here_);
        here_ += sizeof(T);
        return value;
    }

    void skip(const PlyProperty& property, std::uint64_t values) {
        require(property, values);
        here_ += values * size_of(property.type);
    }

    /// That many values can still follow. @throws Error(MalformedInput) when not.
    void require(const PlyProperty& property, std::uint64_t values) const {
        if (values > remaining() / size_of(property.type)) fail_list(property, values);
    }

    /// All of the element can still follow.
    void require(const PlyElement& element) const {
        (void)earliest_end(element, kEncoding, static_cast<std::uint64_t>(here_ - file_),
                           static_cast<std::uint64_t>(end_ - file_));
    }

    [[noreturn]] void fail(const PlyProperty* property, const std::string& what) const {
        throw Error(ErrorCode::MalformedInput, "PLY body, byte " + std::to_string(here_ - file_) +
                                                   " (" + place.describe(property) + "): " + what);
    }

private:
    [[noreturn]] void fail_at_end(const PlyProperty* property) const {
        fail(property, "the file ends here, but the header declares " +
                           std::to_string(place.element->count) + " of this element");
    }
    [[noreturn]] void fail_list(const PlyProperty& property, std::uint64_t values) const {
        fail(&property, "a list of " + std::to_string(values) + " values of " +
                            std::to_string(size_of(property.type)) + " bytes, but only " +
                            std::to_string(remaining()) + " bytes follow");
    }

    // Of the bytes of this machine, whose order is that of the file unless they are swapped.
    static constexpr PlyEncoding kEncoding =
        kSwap ? PlyEncoding::BinaryBigEndian : PlyEncoding::BinaryLittleEndian;

    const std::byte* file_;
    const std::byte* here_;
    const std::byte* end_;
};

class AsciiCursor {
public:
    PlyPlace place;
    bool within_line = false;  ///< a value may not be sought beyond the end of the line

    AsciiCursor(std::span<const std::byte> file, std::size_t from)
        : file_(reinterpret_cast<const char*>(file.data())),
          here_(file_ + from),
          end_(file_ + file.size()) {}

    const char* position() const noexcept { return here_; }
    void seek(const char* position) noexcept { here_ = position; }
    std::size_t remaining() const noexcept { return static_cast<std::size_t>(end_ - here_); }

    template <typename T>
    T read(const PlyProperty& property) {
        seek_word(property);
        T value;
        const char* const stop = ply_number::parse(here_, end_, value);
        if (stop == nullptr) fail_value(property, property.type);
        here_ = stop;
        return value;
    }

    void skip(const PlyProperty& property, std::uint64_t values) {
        for (; values != 0; --values) {
            seek_word(property);
            here_ += ply_number::word_at(here_, end_).size();
        }
    }

    void require(const PlyProperty& property, std::uint64_t values) const {
        if (values > remaining() / 2 + 1) {
            fail(&property, "a list of " + std::to_string(values) + " values, but only " +
                                std::to_string(remaining()) + " bytes follow");
        }
    }

    void require(const PlyElement& element) const {
        (void)earliest_end(element, PlyEncoding::Ascii, static_cast<std::uint64_t>(here_ - file_),
                           static_cast<std::uint64_t>(end_ - file_));
    }

    /// Passes blanks; true at the end of a line or of the file, which is not passed.
    bool at_end_of_line() noexcept {
        while (here_ != end_ && *here_ != '\n' && ply_number::is_blank(*here_)) ++here_;
        return here_ == end_ || *here_ == '\n';
    }

    void skip_blanks() noexcept {
        while (here_ != end_ && ply_number::is_blank(*here_)) ++here_;
    }

    /// The row of the element ends with its line.
    void expect_end_of_line() {
        if (!at_end_of_line()) {
            fail(nullptr, "the line goes on with " + in_quotes(ply_number::word_at(here_, end_)) +
                              " after the " + std::to_string(place.element->properties.size()) +
                              " properties of the header");
        }
    }

    [[noreturn]] void fail(const PlyProperty* property, const std::string& what) const {
        // Old Macintosh files end their lines in CR alone.
        const auto line =
            1 + std::max(std::count(file_, here_, '\n'), std::count(file_, here_, '\r'));
        throw Error(ErrorCode::MalformedInput, "PLY body, line " + std::to_string(line) + " (" +
                                                   place.describe(property) + "): " + what);
    }

    /// The word here is not of that type.
    [[noreturn]] void fail_value(const PlyProperty& property, PlyType type) const {
        std::string expected = "a number";
        if (type != PlyType::Float32 && type != PlyType::Float64) {
            expected = with_type(type, []<typename T>() {
                return "a whole number " + std::to_string(std::numeric_limits<T>::min()) + ".." +
                       std::to_string(std::numeric_limits<T>::max());
            });
        }
        fail(&property, in_quotes(ply_number::word_at(here_, end_)) + ": expected " + expected);
    }

private:
    void seek_word(const PlyProperty& property) {
        while (here_ != end_ && ply_number::is_blank(*here_) && !(within_line && *here_ == '\n'))
            ++here_;
        if (here_ == end_) {
            fail(&property, "the file ends here, but the header declares " +
                                std::to_string(place.element->count) + " of this element");
        }
        if (*here_ == '\n' && within_line) fail(&property, "the line ends before this value");
    }

    const char* file_;
    const char* here_;
    const char* end_;
};

/// The length of a list.
template <typename Cursor>
std::uint64_t read_list_length(Cursor& cursor, const PlyProperty& property) {
    PlyProperty length{property.name, *property.count_type, {}};
    return with_type(length.type, [&]<typename T>() -> std::uint64_t {
        if constexpr (std::integral<T>) {
            const T value = cursor.template read<T>(length);
            if (std::cmp_less(value, 0)) {
                cursor.fail(&property, "a list of " + std::to_string(value) + " values");
            }
            return static_cast<std::uint64_t>(value);
        }
        return 0;  // the header lets no other type pass
    });
}

}  // namespace stipple
