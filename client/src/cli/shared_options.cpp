#include "cli/shared_options.hpp"

#include "cli/files.hpp"
#include "cli/names.hpp"
#include "cli/numbers.hpp"
#include "cli/units.hpp"
#include "stipple/proto/option_names.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <functional>
#include <iterator>
#include <set>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRemoveOutliers = "--remove-outliers";

PlyEncoding ply_encoding(const std::string& name) {
    if (name == "le") return PlyEncoding::BinaryLittleEndian;
    if (name == "be") return PlyEncoding::BinaryBigEndian;
    if (name == "ascii") return PlyEncoding::Ascii;
    throw UsageError("--ply-encoding " + name + ": expected le, be or ascii");
}

}  // namespace

void add_common(CLI::App& command, CommonOptions& common) {
    command.add_option("--threads", common.threads, "threads of a local run; 0: one per core")
        ->type_name("T")
        ->check(CLI::Range(0, 1024));
    command.add_option("--json", common.json, "write the figures as JSON; - for standard output")
        ->type_name("FILE");
    command.add_flag("-q,--quiet", common.quiet, "no progress and no summary");
}

void add_input(CLI::App& command, std::string& input) {
    command.add_option("IN", input, "a PLY, Draco or progressive file, whatever its name")
        ->required()
        ->type_name("FILE");
}

void add_output(CLI::App& command, std::string& output) {
    command.add_option("OUT", output, "a .ply or .drc file")->required()->type_name("FILE");
}

void add_seed(CLI::App& command, std::uint64_t& seed) {
    command.add_option("--seed", seed, "for methods that use random numbers")
        ->type_name("S")
        ->capture_default_str()
        ->transform(whole_number());
}

void add_no_error(CLI::App& command, bool& no_error) {
    command.add_flag("--no-error", no_error, "do not measure the error of the result");
}

void add_remove_outliers(CLI::App& command, std::optional<double>& deviations) {
    command
        .add_option(kRemoveOutliers, deviations,
                    "first remove points off all surfaces and lines; S: 1..100 standard "
                    "deviations, 2.5 if not given; the more, the fewer")
        ->type_name("[S]")
        ->transform(real_number("standard deviations, 1..100, as in 2.5"));
}

std::optional<OutlierOptions> outlier_options(const std::optional<double>& deviations) {
    if (!deviations) return std::nullopt;
    const OutlierOptions options{.deviations = *deviations};
    validate(options);
    return options;
}

std::vector<std::string> with_deviations(std::vector<std::string> arguments) {
    for (auto word = arguments.begin(); word != arguments.end() && *word != "--"; ++word) {
        if (*word != kRemoveOutliers) continue;
        const auto next = std::next(word);
        if (next == arguments.end() || !finite_number(*next))
            *word += "=" + three_digits(OutlierOptions{}.deviations);
    }
    return arguments;
}

void add_server(CLI::App& command, ServerValues& values) {
    command
        .add_option("--server", values.server.url, "run on this stippled server: http://HOST:PORT")
        ->type_name("URL")
        ->each([&values](const std::string&) { values.given = true; });
    command
        .add_option("--api-key", values.server.api_key, "its API key; better set STIPPLE_API_KEY")
        ->type_name("KEY");
}

ServerOptions server_options(const ServerValues& values) {
    ServerOptions server = values.server;
    const char* const key = std::getenv("STIPPLE_API_KEY");
    if (values.given && server.url.empty())
        throw UsageError("--server: empty: expected http://HOST:PORT");
    if (server.url.empty() && !server.api_key.empty())
        throw UsageError("--api-key without --server: name the server that the key is for");
    if (server.api_key.empty() && key != nullptr) server.api_key = key;
    return server;
}

void add_reductions(CLI::App& command, std::vector<std::string>& reductions) {
    command
        .add_option("--reduce", reductions,
                    "mean, nearest, min, max or mode, for one attribute, or mean or nearest for "
                    "color or normal; repeat for others")
        ->type_name("NAME=POLICY")
        ->allow_extra_args(false);
}

std::map<std::string, Reduction> reductions_of(const std::vector<std::string>& texts) {
    std::map<std::string, Reduction> reductions;
    for (const std::string& text : texts) {
        const std::size_t equals = text.rfind('=');  // a name may have others
        if (equals == 0 || equals == text.npos)
            throw UsageError("--reduce " + text + ": expected NAME=POLICY, as in intensity=max");
        reductions[text.substr(0, equals)] =
            named("--reduce", text.substr(equals + 1), proto::reduction_from_name);
    }
    return reductions;
}

void add_added_attributes(CLI::App& command, AddedValues& values) {
    add_no_error(command, values.no_error);
    command
        .add_option("--splats", values.splats,
                    "splat attributes to write: none, radius, normal or ellipse; they replace "
                    "those of IN of the same names")
        ->type_name("S")
        ->capture_default_str();
    command.add_flag("--source-index", values.source_index,
                     "write each point's number in IN as source_index");
}

proto::AddedAttributes added_attributes(const AddedValues& values) {
    return {named("--splats", values.splats, proto::splats_from_name), values.source_index};
}

void add_draco(CLI::App& command, EncodingValues& values, const std::string& precise) {
    auto* const bits = command
                           .add_option("--position-bits", values.draco.position_bits,
                                       "for .drc: 1..30, or 0: exact floats; default 14")
                           ->type_name("B")
                           ->transform(bit_count(1, 30, "exact floats"));
    command
        .add_option("--precision", values.precision,
                    "for " + precise + ": largest error per axis, input units")
        ->type_name("E")
        ->excludes(bits)
        ->transform(precision());
    command.add_option("--normal-bits", values.draco.normal_bits, "for .drc: 2..30; default 10")
        ->type_name("B")
        ->transform(bit_count(2, 30));
    command
        .add_option("--attribute-bits", values.draco.attribute_bits,
                    "for .drc: 1..30 for floats, or 0: exact floats; default 16")
        ->type_name("B")
        ->transform(bit_count(1, 30, "exact floats"));
    command
        .add_option("--coding", values.coding,
                    "for .drc: auto (default), sequential (keeps the order) or kd-tree")
        ->type_name("C");
}

void add_ply(CLI::App& command, EncodingValues& values) {
    command
        .add_option("--ply-encoding", values.ply_encoding, "for .ply: le (default), be or ascii")
        ->type_name("E");
}

DracoEncodeOptions draco_options(const EncodingValues& values) {
    DracoEncodeOptions draco = values.draco;
    draco.coding = named("--coding", values.coding, proto::draco_coding_from_name);
    draco.precision = values.precision;
    return draco;
}

PlyEncodeOptions ply_options(const EncodingValues& values) {
    return {ply_encoding(values.ply_encoding), {}};
}

void add_encoding(CLI::App& command, FileValues& values) {
    add_draco(command, values.encoding);
    add_ply(command, values.encoding);
    add_server(command, values.server);
    add_common(command, values.common);
}

CloudFormat format_of(const fs::path& file, std::string_view endings) {
    const std::string extension = extension_of(file);
    if (extension == ".ply") return CloudFormat::Ply;
    if (extension == ".drc") return CloudFormat::Draco;
    throw UsageError(file.string() + ": the name must end with " + std::string(endings));
}

const FormatOption* option_of_no_format(const CLI::App& command,
                                        std::span<const FormatOption> options,
                                        const std::set<std::string, std::less<>>& formats) {
    const auto lost = std::ranges::find_if(options, [&](const FormatOption& option) {
        const CLI::Option* const given = command.get_option_no_throw(option.name);
        return given != nullptr && given->count() > 0 &&
               std::ranges::none_of(option.takers, [&](auto own) { return formats.contains(own); });
    });
    return lost == options.end() ? nullptr : &*lost;
}

void require_options_of_formats(const CLI::App& command, const std::vector<std::string>& outputs) {
    static const std::array kOptions = {FormatOption{"--position-bits", {".drc"}},
                                        FormatOption{"--normal-bits", {".drc"}},
                                        FormatOption{"--attribute-bits", {".drc"}},
                                        FormatOption{"--coding", {".drc"}},
                                        FormatOption{"--precision", {".drc", ".laz", ".stpc"}},
                                        FormatOption{"--ply-encoding", {".ply"}},
                                        FormatOption{"--epsg", {".laz"}},
                                        FormatOption{"--range", {".png", ".ply", ".drc"}},
                                        FormatOption{"--views", {".png"}},
                                        FormatOption{"--up", {".png"}}};
    std::set<std::string, std::less<>> given;
    for (const fs::path output : outputs) given.insert(extension_of(output));
    const FormatOption* const lost = option_of_no_format(command, kOptions, given);
    if (lost == nullptr) return;
    const std::string own(lost->takers.front());
    throw UsageError(
        std::string(lost->name) + ": belongs to " + own +
        (command.get_name() == "evaluate"
             ? ": omit it, or add a --map that ends with " + own
             : ", not to " + *given.begin() + ": omit it, or change the ending of OUT"));
}

void hide(CLI::App& command, std::initializer_list<const char*> bounds) {
    for (const char* const bound : bounds) command.get_option(bound)->group("");
}

}  // namespace stipple::cli
