#pragma once

#include "cli/command_line.hpp"
#include "stipple/error.hpp"

#include <string>

namespace stipple::cli {

/// What a word on the command line stands for, by one of the `..._from_name`.
/// @throws UsageError naming the option and the words there are.
template <typename FromName>
auto named(const std::string& option, const std::string& word, FromName&& from_name) {
    try {
        return from_name(word);
    } catch (const Error& error) {
        throw UsageError(option + " " + error.what());
    }
}

}  // namespace stipple::cli
