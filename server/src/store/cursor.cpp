#include "store/cursor.hpp"

#include "stipple/error.hpp"

#include <algorithm>
#include <charconv>

namespace stipple::server {

namespace {

constexpr std::string_view kDigits =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
constexpr unsigned kBitsPerDigit = 6;
constexpr unsigned kBitsPerByte = 8;

std::string base64url(std::string_view bytes) {
    std::string text;
    unsigned bits = 0;
    unsigned held = 0;
    for (const char byte : bytes) {
        bits = bits << kBitsPerByte | static_cast<unsigned char>(byte);
        held += kBitsPerByte;
        for (; held >= kBitsPerDigit; held -= kBitsPerDigit) {
            text += kDigits[bits >> (held - kBitsPerDigit) & 63];
        }
    }
    if (held > 0) text += kDigits[bits << (kBitsPerDigit - held) & 63];
    return text;
}

/// What stands after the first character that is no digit is left out; `decode_cursor` notices.
std::string from_base64url(std::string_view text) {
    std::string bytes;
    unsigned bits = 0;
    unsigned held = 0;
    for (const char digit : text) {
        const std::size_t value = kDigits.find(digit);
        if (value == std::string_view::npos) break;
        bits = bits << kBitsPerDigit | static_cast<unsigned>(value);
        held += kBitsPerDigit;
        if (held < kBitsPerByte) continue;
        held -= kBitsPerByte;
        bytes += static_cast<char>(bits >> held & 255);
    }
    return bytes;
}

}  // namespace

std::string encode_cursor(std::string_view listing, std::int64_t row) {
    return base64url(std::string(listing) + ':' + std::to_string(row));
}

std::int64_t decode_cursor(std::string_view listing, std::string_view cursor) {
    constexpr std::size_t kLongest = 64;
    const std::string text = from_base64url(cursor.substr(0, kLongest));
    const std::size_t colon = text.find(':');
    std::int64_t row = 0;
    if (colon != std::string::npos) {
        std::from_chars(text.data() + colon + 1, text.data() + text.size(), row);
    }
    // Written again, it must be what came: one row has one cursor.
    if (row <= 0 || encode_cursor(listing, row) != cursor) {
        std::string shown(cursor.substr(0, kLongest));
        std::ranges::replace(shown, '\0', '?');  // at which the text of an exception would end
        throw Error(ErrorCode::InvalidArgument,
                    "cursor \"" + shown +
                        "\": expected the `next` of a page of this listing; omit it for the "
                        "first page");
    }
    return row;
}

}  // namespace stipple::server
