#include "cli/unknown_words.hpp"

#include "cli/command_line.hpp"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <numeric>
#include <string_view>
#include <utility>

namespace stipple::cli {
namespace {

/// Characters to put in, take out or change until one word is the other.
std::size_t edit_distance(std::string_view a, std::string_view b) {
    std::vector<std::size_t> row(b.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < a.size(); ++i) {
        std::size_t diagonal = std::exchange(row[0], i + 1);
        for (std::size_t j = 0; j < b.size(); ++j) {
            const std::size_t changed = diagonal + (a[i] == b[j] ? 0 : 1);
            diagonal = row[j + 1];
            row[j + 1] = std::min({row[j] + 1, diagonal + 1, changed});
        }
    }
    return row.back();
}

/// The long option, of those in the help, that was probably meant; empty when none is near.
std::string option_near(const CLI::App& command, const std::string& name) {
    std::vector<const CLI::Option*> options = command.get_options();
    for (const CLI::App* const group : command.get_subcommands({}))
        std::ranges::copy(group->get_options(), std::back_inserter(options));
    const std::size_t letters = name.size() - 2;
    std::size_t distance = 1 + std::min<std::size_t>(2, letters / 3);
    std::string nearest;
    for (const CLI::Option* const option : options) {
        for (const std::string& known : option->get_lnames()) {
            const std::size_t edits = edit_distance(name, "--" + known);
            if (option->get_group().empty() || edits >= distance) continue;
            nearest = "--" + known;
            distance = edits;
        }
    }
    return nearest;
}

}  // namespace

void require_command(const CLI::App& app, const std::vector<std::string>& arguments) {
    if (arguments.empty()) return;
    const std::string& first = arguments.front();
    if (first.starts_with('-')) {
        const bool is_short = first.size() > 1 && first[1] != '-';
        if (is_short && app.get_option_no_throw(first.substr(0, 2)) == nullptr)
            throw UsageError(first + ": give it after the command, as in: stipple COMMAND FILE " +
                             first);
        return;
    }
    std::string names;
    for (const CLI::App* const command : app.get_subcommands({})) {
        if (command->check_name(first)) return;
        names += (names.empty() ? "" : ", ") + command->get_name();
    }
    throw UsageError(first + ": no such command: expected one of " + names);
}

void require_known_options(const CLI::App& app, const std::vector<std::string>& arguments) {
    const auto commands = app.get_subcommands(
        [&](const CLI::App* command) { return command->check_name(arguments.front()); });
    const CLI::App& command = commands.empty() ? app : *commands.front();
    for (const std::string& argument : arguments) {
        if (argument == "--") return;
        const std::string name = argument.substr(0, argument.find('='));
        if (!name.starts_with("--") || command.get_option_no_throw(name) != nullptr) continue;
        const std::string near = option_near(command, name);
        if (near == name)  // of a command, which is yet to come
            throw UsageError(name + ": give it after the command, as in: stipple COMMAND FILE " +
                             name);
        throw UsageError(name + ": no such option" +
                         (near.empty() ? " (see --help)" : ": did you mean " + near + "?"));
    }
}

}  // namespace stipple::cli
