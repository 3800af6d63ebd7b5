#pragma once

#include <CLI/CLI.hpp>
#include <charconv>
#include <cstdint>
#include <exception>
#include <iostream>
#include <string>
#include <system_error>

namespace stipple::bench {

/// A whole number: CLI11 alone takes -1 for 2^64 - 1.
inline CLI::Validator at_least(std::uint64_t least) {
    return CLI::Validator(
        [least](const std::string& text) -> std::string {
            std::uint64_t value = 0;
            const char* const end = text.data() + text.size();
            const auto [stop, error] = std::from_chars(text.data(), end, value);
            if (error == std::errc() && stop == end && value >= least) return {};
            return text + ": expected a whole number, " + std::to_string(least) + " or more";
        },
        "");
}

/// The main of each program here: reads the command line, then does `work`.
/// @param work  returns the exit code.
/// @return that; 0 after help, 1 when the work fails, 2 when the command line is refused.
template <typename Work>
int run_program(CLI::App& app, int argc, const char* const* argv, Work&& work) {
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : 2;
    }
    try {
        return work();
    } catch (const std::exception& error) {
        std::cerr << app.get_name() << ": " << error.what() << '\n';
        return 1;
    }
}

}  // namespace stipple::bench
