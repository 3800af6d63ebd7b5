#pragma once

#include <CLI/CLI.hpp>
#include <exception>
#include <iostream>

namespace stipple::bench {

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
