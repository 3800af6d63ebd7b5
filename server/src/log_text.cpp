#include "log_text.hpp"

#include <algorithm>

namespace stipple::server {

std::string log_text(std::string_view text) {
    constexpr std::string_view kDigits = "0123456789abcdef";
    std::string result = "\"";
    for (const char c : text) {
        const auto byte = static_cast<unsigned char>(c);
        if (c == '"' || c == '\\') {
            result += {'\\', c};
        } else if (byte < ' ' || byte == 0x7F) {
            result += {'\\', 'x', kDigits[byte >> 4U], kDigits[byte & 15U]};
        } else {
            result += c;
        }
    }
    return result + '"';
}

std::string log_name(std::string_view name) {
    const auto is_plain = [](char c) {
        return ('a' <= c && c <= 'z') || ('A' <= c && c <= 'Z') || ('0' <= c && c <= '9') ||
               std::string_view("-_.@:").find(c) != std::string_view::npos;
    };
    if (name.empty()) return "-";
    return std::ranges::all_of(name, is_plain) ? std::string(name) : log_text(name);
}

}  // namespace stipple::server
