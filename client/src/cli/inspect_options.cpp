#include "cli/command_options.hpp"
#include "cli/shared_options.hpp"

#include <memory>
#include <string>

namespace stipple::cli {
namespace {

struct Values {
    std::string input;
    CommonOptions common;
};

InspectCommand inspect_command(const Values& values) {
    return {values.input, values.common};
}

}  // namespace

CommandReader add_inspect(CLI::App& app) {
    const auto shared = std::make_shared<Values>();
    Values& values = *shared;
    CLI::App& command = *app.add_subcommand("inspect", "what a file contains");
    add_input(command, values.input);
    add_common(command, values.common);
    command.footer(
        "Examples:\n"
        "  stipple inspect scan.ply\n"
        "  stipple inspect scan.drc --json -");
    return {&command, [shared] { return inspect_command(*shared); }};
}

}  // namespace stipple::cli
