#include "cli/units.hpp"

#include "cli/terminal.hpp"

#include <array>
#include <cmath>
#include <cstdio>

namespace stipple::cli {
namespace {

std::string with_decimals(double value, int decimals) {
    std::array<char, 64> text{};
    std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
    return text.data();
}

/// Whole from ten on, one decimal below it, but no `.0` where nothing is behind the point.
std::string short_number(double value) {
    const std::string text = with_decimals(value, value < 9.95 ? 1 : 0);
    return text.ends_with(".0") ? text.substr(0, text.size() - 2) : text;
}

}  // namespace

std::string three_digits(double value) {
    std::array<char, 64> text{};
    std::snprintf(text.data(), text.size(), "%.3g", value);
    return text.data();
}

std::string two_digits(double value) {
    std::array<char, 64> text{};
    std::snprintf(text.data(), text.size(), "%.2g", value);
    return text.data();
}

std::string counted(std::uint64_t count, const std::string& one, const std::string& many) {
    const std::string& noun = count == 1 ? one : many;
    return with_separators(count) + " " + (noun.empty() ? one + "s" : noun);
}

std::string joined(const std::vector<std::string>& parts, std::string_view separator) {
    std::string text;
    for (const std::string& part : parts)
        text += (text.empty() ? "" : std::string(separator)) + part;
    return text;
}

std::string readable_bytes(std::uint64_t bytes) {
    static constexpr std::array<const char*, 5> kUnits = {" B", " kB", " MB", " GB", " TB"};
    auto value = static_cast<double>(bytes);
    std::size_t unit = 0;
    while (value >= 999.5 && unit + 1 < kUnits.size()) {
        value /= 1000;
        ++unit;
    }
    const int decimals = unit == 0 || value >= 99.95 ? 0 : 1;
    std::string text = with_decimals(value, decimals);
    if (text.ends_with(".0")) text.resize(text.size() - 2);
    return text + kUnits[unit];
}

std::string readable_seconds(double seconds) {
    if (seconds < 0.9995) return short_number(seconds * 1000) + " ms";
    if (seconds < 59.5) return short_number(seconds) + " s";
    const auto whole = static_cast<std::uint64_t>(std::llround(seconds));
    if (whole < 3600)
        return std::to_string(whole / 60) + " min " + std::to_string(whole % 60) + " s";
    return std::to_string(whole / 3600) + " h " + std::to_string(whole % 3600 / 60) + " min";
}

std::string readable_share(std::uint64_t part, std::uint64_t whole) {
    if (whole == 0) return "0 %";
    const double percent = 100.0 * static_cast<double>(part) / static_cast<double>(whole);
    if (part > 0 && percent < 0.05) return "<0.1 %";
    return short_number(percent) + " %";
}

std::string in_left(const std::string& text, std::size_t columns) {
    const unsigned width = display_width(text);
    return width < columns ? text + std::string(columns - width, ' ') : text;
}
std::string in_right(const std::string& text, std::size_t columns) {
    const unsigned width = display_width(text);
    return width < columns ? std::string(columns - width, ' ') + text : text;
}

}  // namespace stipple::cli
