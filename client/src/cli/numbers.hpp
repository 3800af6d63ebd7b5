#pragma once

#include "stipple/proto/byte_size.hpp"

#include <CLI/CLI.hpp>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

// How numbers are read from the command line: each for `transform`, the last of an option.

namespace stipple::cli {

/// CLI11 alone reads -3 as 2^64 - 3, 010 as 8 and more than 2^64 as 2^64 - 1.
inline CLI::Validator whole_number() {
    return CLI::Validator(
        [](std::string& text) -> std::string {
            std::uint64_t value = 0;
            const char* const end = text.data() + text.size();
            const auto [stop, error] = std::from_chars(text.data(), end, value);
            if (error != std::errc() || stop != end)
                return text + ": expected a whole number, as in 5000";
            text = std::to_string(value);
            return {};
        },
        "");
}

/// For an `unsigned`, whose limits are checked elsewhere. @param expected  as in `3..32`.
inline CLI::Validator small_number(std::string expected) {
    return CLI::Validator(
        [expected = std::move(expected)](std::string& text) -> std::string {
            const bool fits = whole_number()(text).empty() && std::stoull(text) <= UINT32_MAX;
            return fits ? "" : text + ": expected a whole number, " + expected;
        },
        "");
}

/// Bits of a quantised value. @param exact  what 0 stands for; null: nothing.
inline CLI::Validator bit_count(unsigned least, unsigned most, const char* exact = nullptr) {
    return CLI::Validator(
        [least, most, exact](std::string& text) -> std::string {
            const bool whole = whole_number()(text).empty();
            const std::uint64_t bits = whole ? std::stoull(text) : most + 1;
            if ((bits >= least && bits <= most) || (bits == 0 && exact != nullptr)) return {};
            return text + ": expected " + std::to_string(least) + ".." + std::to_string(most) +
                   (exact == nullptr ? "" : std::string(", or 0: ") + exact);
        },
        "");
}

/// The whole text as a finite number.
inline std::optional<double> finite_number(std::string_view text) {
    double value = 0;
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    const bool whole = error == std::errc() && stop == end;
    return whole && std::isfinite(value) ? std::optional(value) : std::nullopt;
}

/// A number whose limits are checked elsewhere: CLI11 alone takes nothing for 0 and tells no limit.
/// @param expected  as in `a number in [0, 1]`.
inline CLI::Validator real_number(std::string expected) {
    return CLI::Validator(
        [expected = std::move(expected)](std::string& text) -> std::string {
            return finite_number(text) ? "" : text + ": expected " + expected;
        },
        "");
}

/// The largest error that `--precision` allows.
inline CLI::Validator precision() {
    return CLI::Validator(
        [](std::string& text) -> std::string {
            if (finite_number(text).value_or(0) > 0) return {};
            return text + ": expected a length above 0, in input units, as in 0.001";
        },
        "");
}

/// `5000`, `10k`, `1.5M`, `1e6` as points.
/// @param ratio  the option of the command that takes `10%`, if one does.
inline CLI::Validator point_count(const char* ratio = nullptr) {
    return CLI::Validator(
        [ratio](std::string& text) -> std::string {
            if (whole_number()(text).empty()) return {};
            double value = 0;
            const char* const end = text.data() + text.size();
            const bool scientific = text.find_first_of("eE") != text.npos;
            const auto [stop, error] = std::from_chars(
                text.data(), end, value,
                scientific ? std::chars_format::scientific : std::chars_format::fixed);
            const std::string_view unit(stop, end);
            const double points = value * (scientific    ? (unit.empty() ? 1 : 0)
                                           : unit == "k" ? 1e3
                                           : unit == "M" ? 1e6
                                                         : 0);
            constexpr double kMost = 1e15, kRounding = 1e-6;
            if (error != std::errc() || !(points >= 1) || points > kMost ||
                std::abs(points - std::round(points)) > kRounding)
                return text + ": expected points, as in 5000, 10k, 1.5M or 1e6" +
                       (ratio != nullptr && unit == "%"
                            ? std::string("; a share of them is ") + ratio + " " + text
                            : "");
            text = std::to_string(std::llround(points));
            return {};
        },
        "");
}

/// `14600`, `15kB`, `1.5 MiB` as bytes.
inline CLI::Validator byte_count() {
    return CLI::Validator(
        [](std::string& text) -> std::string {
            if (const auto bytes = proto::bytes_of_size(text)) {
                text = std::to_string(*bytes);
                return {};
            }
            return text + ": expected bytes, as in 14600, 15kB or 1.5MiB";
        },
        "");
}

/// `0.1` or `10%`.
inline CLI::Validator share() {
    return CLI::Validator(
        [](std::string& text) -> std::string {
            double value = 0;
            const char* const end = text.data() + text.size();
            const auto [stop, error] = std::from_chars(text.data(), end, value);
            const std::string_view unit(stop, end);
            if (error != std::errc() || (!unit.empty() && unit != "%"))
                return text + ": expected a ratio, as in 0.1 or 10%";
            if (unit.empty()) return {};
            std::array<char, 32> part{};  // the shortest text of a double has 24 characters
            text.assign(part.data(), std::to_chars(part.begin(), part.end(), value / 100).ptr);
            return {};
        },
        "");
}

}  // namespace stipple::cli
