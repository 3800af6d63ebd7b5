#include "stipple/proto/byte_size.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <string>
#include <system_error>
#include <utility>

namespace stipple::proto {

std::optional<std::uint64_t> bytes_of_size(std::string_view text, std::chars_format format) {
    static constexpr std::array<std::pair<std::string_view, double>, 14> kUnits = {{
        {"", 1},
        {"b", 1},
        {"k", 1e3},
        {"m", 1e6},
        {"g", 1e9},
        {"t", 1e12},
        {"kb", 1e3},
        {"mb", 1e6},
        {"gb", 1e9},
        {"tb", 1e12},
        {"kib", 0x1p10},
        {"mib", 0x1p20},
        {"gib", 0x1p30},
        {"tib", 0x1p40},
    }};
    double number = 0;
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, number, format);
    if (error != std::errc()) return std::nullopt;
    std::string name(stop, end);
    name.erase(0, name.find_first_not_of(' '));
    name.erase(name.find_last_not_of(' ') + 1);
    std::ranges::transform(name, name.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    const auto* const unit = std::ranges::find(kUnits, name, &decltype(kUnits)::value_type::first);
    if (unit == kUnits.end()) return std::nullopt;
    constexpr double kMost = 1e18;
    const double bytes = number * unit->second;
    if (!(bytes >= 0 && bytes <= kMost)) return std::nullopt;
    return static_cast<std::uint64_t>(bytes);
}

}  // namespace stipple::proto
