#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

// What is said of a word that nobody knows.

namespace stipple::cli {

/// Of the first argument: CLI11 would list all that follows an unknown command, last things first.
/// @throws UsageError with the commands there are.
void require_command(const CLI::App& app, const std::vector<std::string>& arguments);
/// CLI11 would list all that it could not place, last things first, or name only what is missing.
/// @throws UsageError naming the first unknown option, with the one that was probably meant.
void require_known_options(const CLI::App& app, const std::vector<std::string>& arguments);

}  // namespace stipple::cli
