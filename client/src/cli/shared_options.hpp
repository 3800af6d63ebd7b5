#pragma once

#include "cli/command_line.hpp"

#include <CLI/CLI.hpp>
#include <charconv>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// Options that several commands share: what they are read into before they are checked, what their
// help says, and what they mean.

namespace stipple::cli {

void add_common(CLI::App& command, CommonOptions& common);
void add_input(CLI::App& command, std::string& input);
void add_output(CLI::App& command, std::string& output);
void add_seed(CLI::App& command, std::uint64_t& seed);
void add_no_error(CLI::App& command, bool& no_error);
void add_remove_outliers(CLI::App& command, std::optional<double>& deviations);
std::optional<OutlierOptions> outlier_options(const std::optional<double>& deviations);
/// `--remove-outliers` may stand without a value: CLI11 would take the next word for it.
std::vector<std::string> with_deviations(std::vector<std::string> arguments);

struct ServerValues {
    ServerOptions server;
    bool given = false;  ///< it may be empty
};
void add_server(CLI::App& command, ServerValues& values);
ServerOptions server_options(const ServerValues& values);

/// Each NAME=POLICY.
void add_reductions(CLI::App& command, std::vector<std::string>& reductions);
std::map<std::string, Reduction> reductions_of(const std::vector<std::string>& texts);

struct AddedValues {
    std::string splats = "radius";
    bool source_index = false, no_error = false;
};
void add_added_attributes(CLI::App& command, AddedValues& values);
proto::AddedAttributes added_attributes(const AddedValues& values);

struct EncodingValues {
    DracoEncodeOptions draco;
    std::optional<double> precision;
    std::string coding = "auto", ply_encoding = "le";
};
/// @param precise  what of its files `--precision` is about.
void add_draco(CLI::App& command, EncodingValues& values, const std::string& precise = ".drc");
void add_ply(CLI::App& command, EncodingValues& values);
DracoEncodeOptions draco_options(const EncodingValues& values);
PlyEncodeOptions ply_options(const EncodingValues& values);

/// Of a command that makes one file of another.
struct FileValues {
    std::string input, output;
    EncodingValues encoding;
    ServerValues server;
    CommonOptions common;
};
/// How the cloud is written, and where the work is done.
void add_encoding(CLI::App& command, FileValues& values);

/// The format that the end of a name says. @throws UsageError.
CloudFormat format_of(const std::filesystem::path& file, std::string_view endings = ".ply or .drc");
/// An option and the formats that take it.
struct FormatOption {
    const char* name;
    std::vector<std::string_view> takers;
};
/// The first option that was given and that none of the formats takes, so that it would change
/// nothing; null when there is none.
const FormatOption* option_of_no_format(const CLI::App& command,
                                        std::span<const FormatOption> options,
                                        const std::set<std::string, std::less<>>& formats);

/// An option of another format than those of the outputs would change nothing. @throws UsageError.
void require_options_of_formats(const CLI::App& command, const std::vector<std::string>& outputs);

/// Leaves bounds out of the help: they are refused, for the command has counts of its own.
void hide(CLI::App& command, std::initializer_list<const char*> bounds);

/// A number of input units, or a percentage of the diagonal.
template <typename Options>
void set_max_error(const std::string& text, Options& options) {
    if (text.empty()) return;
    double value = 0;
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    if (error == std::errc() && stop == end)
        options.max_error = value;
    else
        options.max_error_rel = proto::part_of_diagonal(text);
}

/// All of a command but the options of its job.
template <typename Job>
FileCommand<Job> file_command(const FileValues& values) {
    FileCommand<Job> command{values.input,
                             values.output,
                             {},
                             ply_options(values.encoding),
                             server_options(values.server),
                             values.common};
    command.job.output = {{format_of(values.output)}, draco_options(values.encoding)};
    return command;
}

}  // namespace stipple::cli
