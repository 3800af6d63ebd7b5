#include "cli/text.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace stipple::cli {
namespace {

/// As in the figures of `--json`.
std::string valid_utf8(std::string_view text) {
    using nlohmann::json;
    const json quoted = text;
    return json::parse(quoted.dump(-1, ' ', false, json::error_handler_t::replace))
        .get<std::string>();
}

}  // namespace

std::string printable(std::string_view text) {
    std::string line = valid_utf8(text);
    std::ranges::replace_if(
        line, [](unsigned char c) { return c < 0x20 || c == 0x7f; }, ' ');
    // C1: U+0080 to U+009F.
    for (std::size_t at = line.find('\xc2'); at != line.npos; at = line.find('\xc2', at + 1))
        if (static_cast<unsigned char>(line[at + 1]) < 0xa0) line.replace(at, 2, " ");
    return line;
}

std::string shortened(std::string text, std::size_t most_bytes) {
    if (text.size() <= most_bytes) return text;
    std::size_t end = most_bytes;
    while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xc0U) == 0x80U) --end;
    text.resize(end);
    return text;
}

}  // namespace stipple::cli
