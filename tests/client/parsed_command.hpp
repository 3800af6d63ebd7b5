#pragma once

#include "cli/command_line.hpp"

#include <string>
#include <variant>
#include <vector>

namespace stipple::cli {

/// The command of these words, which must be of type `T`.
template <typename T>
T parsed(const std::vector<std::string>& arguments) {
    return std::get<T>(parse_command_line(arguments));
}

/// Why these words are none, or "accepted".
inline std::string refusal(const std::vector<std::string>& arguments) {
    try {
        parse_command_line(arguments);
    } catch (const UsageError& error) {
        return error.what();
    }
    return "accepted";
}

}  // namespace stipple::cli
