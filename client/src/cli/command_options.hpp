#pragma once

#include "cli/command_line.hpp"

#include <CLI/CLI.hpp>
#include <functional>

namespace stipple::cli {

/// A command of the command line.
struct CommandReader {
    const CLI::App* app;            ///< what it takes, and what its help says
    std::function<Command()> read;  ///< what it means, after `app` was parsed; throws UsageError
};

// Add a command to `app`, which must not parse without what is returned. Each in a file of its
// name: what its options are read into, what they mean together, and what the help says of them.

CommandReader add_simplify(CLI::App& app);
CommandReader add_upsample(CLI::App& app);
CommandReader add_analyze(CLI::App& app);
CommandReader add_pyramid(CLI::App& app);
CommandReader add_slice(CLI::App& app);
CommandReader add_evaluate(CLI::App& app);
CommandReader add_curve(CLI::App& app);
CommandReader add_inspect(CLI::App& app);
CommandReader add_convert(CLI::App& app);
CommandReader add_synthesize(CLI::App& app);

}  // namespace stipple::cli
