#pragma once

#include <string>
#include <string_view>

namespace stipple {

/// Foreign text as it may stand in a message: in quotes, other than printable ASCII as `\xNN`, cut
/// after 40 characters.
inline std::string in_quotes(std::string_view text) {
    constexpr std::size_t kLongest = 40;
    constexpr std::string_view kHex = "0123456789abcdef";
    std::string result = "'";
    for (const char c : text.substr(0, kLongest)) {
        const auto byte = static_cast<unsigned char>(c);
        if (byte >= 0x20 && byte < 0x7f) {
            result += c;
        } else {
            result += {'\\', 'x', kHex[byte >> 4], kHex[byte & 15]};
        }
    }
    return result + (text.size() > kLongest ? "...'" : "'");
}

}  // namespace stipple
