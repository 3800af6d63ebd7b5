#include "cli/help.hpp"

#include <cstddef>
#include <sstream>

namespace stipple::cli {
namespace {

constexpr std::size_t kColumn = 32, kWidth = 78 - kColumn;  // groups are indented

}  // namespace

HelpFormatter::HelpFormatter() {
    column_width(kColumn);
}

std::string HelpFormatter::make_option_desc(const CLI::Option* option) const {
    std::istringstream words(CLI::Formatter::make_option_desc(option));
    std::string text, word;
    std::size_t at = 0;
    while (words >> word) {
        const bool fits = at + 1 + word.size() <= kWidth;
        if (at > 0) text += fits ? ' ' : '\n';
        at = at > 0 && fits ? at + 1 + word.size() : word.size();
        text += word;
    }
    return text;
}

std::string HelpFormatter::make_expanded(const CLI::App* group) const {
    const auto own = group->get_options(
        [group](const CLI::Option* option) { return option != group->get_help_ptr(); });
    return '\n' + make_group(group->get_group(), false, own);
}

std::vector<std::string> with_help_as_option(std::vector<std::string> arguments) {
    if (arguments.empty() || arguments.front() != "help") return arguments;
    arguments.erase(arguments.begin());
    arguments.emplace_back("--help");
    return arguments;
}

}  // namespace stipple::cli
