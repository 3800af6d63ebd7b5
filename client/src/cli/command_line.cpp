#include "cli/command_line.hpp"

#include "cli/command_options.hpp"
#include "cli/help.hpp"
#include "cli/method_options.hpp"
#include "cli/shared_options.hpp"
#include "cli/unknown_words.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
#include <memory>

namespace stipple::cli {
namespace {

/// CLI11 takes arguments from the back.
std::vector<std::string> reversed(std::vector<std::string> arguments) {
    std::reverse(arguments.begin(), arguments.end());
    return arguments;
}

/// A refusal of the library begins with the field that it refuses: here that is an option.
std::string naming_option(const CLI::App& app, const std::string& message) {
    for (const char* const letters :
         {"abcdefghijklmnopqrstuvwxyz_.", "abcdefghijklmnopqrstuvwxyz_"}) {
        const std::string field = message.substr(0, message.find_first_not_of(letters));
        const std::string option = option_of(field);
        for (const CLI::App* const command : app.get_subcommands())
            if (command->get_option_no_throw(option) != nullptr)
                return option + message.substr(field.size());
    }
    return message;
}

std::string one_line(std::string text) {
    std::replace(text.begin(), text.end(), '\n', ' ');
    return text;
}

/// In the order given, which the library turns round.
std::string not_expected(const std::vector<std::string>& words) {
    std::string text = words.size() == 1 ? "not expected:" : "these were not expected:";
    for (const std::string& word : words) text += ' ' + word;
    return text;
}

}  // namespace

Command parse_command_line(const std::vector<std::string>& words) {
    const std::vector<std::string> arguments = with_deviations(with_help_as_option(words));
    CLI::App app("stipple: smaller point clouds that still describe the same surface.", "stipple");
    app.set_version_flag("--version", "stipple " STIPPLE_VERSION);
    app.formatter(std::make_shared<HelpFormatter>());
    app.require_subcommand(0, 1);
    app.footer(
        "Examples:\n"
        "  stipple synthesize ammonite.ply --points 500000\n"
        "  stipple inspect ammonite.ply\n"
        "  stipple simplify ammonite.ply small.drc --points 5000\n"
        "  stipple pyramid ammonite.ply levels/\n"
        "\nstipple COMMAND --help describes each command.");
    const std::array commands = {add_simplify(app),  add_upsample(app), add_analyze(app),
                                 add_pyramid(app),   add_slice(app),    add_evaluate(app),
                                 add_curve(app),     add_inspect(app),  add_convert(app),
                                 add_synthesize(app)};
    require_command(app, arguments);
    try {
        app.parse(reversed(arguments));
        for (const CommandReader& command : commands)
            if (command.app->parsed()) return command.read();
        return InfoCommand{app.help()};
    } catch (const CLI::CallForHelp&) {
        return InfoCommand{app.help()};  // of the command that was asked, when there is one
    } catch (const CLI::CallForVersion& version) {
        return InfoCommand{std::string(version.what()) + "\n"};
    } catch (const CLI::ParseError& error) {
        require_known_options(app, arguments);
        const std::vector<std::string> unexpected = app.remaining(true);
        throw UsageError((unexpected.empty() ? one_line(error.what()) : not_expected(unexpected)) +
                         " (see --help)");
    } catch (const Error& error) {  // an option that the library refuses
        throw UsageError(naming_option(app, error.what()));
    }
}

}  // namespace stipple::cli
