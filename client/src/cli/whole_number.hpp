#pragma once

#include <CLI/CLI.hpp>
#include <charconv>
#include <cstdint>
#include <string>
#include <system_error>

namespace stipple::cli {

/// For `transform`, the last of an option: CLI11 alone reads -3 as 2^64 - 3, 010 as 8 and more
/// than 2^64 as 2^64 - 1. @param with_unit  whether more may follow, for another `transform`.
inline CLI::Validator whole_number(bool with_unit = false) {
    return CLI::Validator(
        [with_unit](std::string& text) -> std::string {
            std::uint64_t value = 0;
            const char* const end = text.data() + text.size();
            const auto [stop, error] = std::from_chars(text.data(), end, value);
            if (error != std::errc() || (stop != end && !with_unit))
                return text + ": expected a whole number from 0 to " + std::to_string(UINT64_MAX);
            text = std::to_string(value) + std::string(stop, end);
            return {};
        },
        "");
}

}  // namespace stipple::cli
