#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace stipple::cli {

/// Help for a terminal of 80 columns.
class HelpFormatter : public CLI::Formatter {
public:
    HelpFormatter();
    std::string make_option_desc(const CLI::Option* option) const override;
    /// Options of which one is needed, under a heading as other groups have it.
    std::string make_expanded(const CLI::App* group) const override;
};

/// `help [COMMAND]` is `[COMMAND] --help`.
std::vector<std::string> with_help_as_option(std::vector<std::string> arguments);

}  // namespace stipple::cli
