#include "cli/command_options.hpp"
#include "cli/files.hpp"
#include "cli/numbers.hpp"
#include "cli/shared_options.hpp"
#include "stipple/globe.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace stipple::cli {
namespace {

struct Values {
    std::string input, output;
    std::optional<std::uint64_t> points, bytes;
    EncodingValues encoding;
    std::optional<unsigned> epsg;
    CommonOptions common;
};

/// What a file that `convert` writes may end with.
constexpr std::string_view kEndings = ".ply, .drc, .stpc or .laz";

ConvertCommand convert_command(const Values& values) {
    const std::string extension = extension_of(values.output);
    if (extension != ".stpc" && extension != ".laz") format_of(values.output, kEndings);
    if (values.epsg) well_known_text(*values.epsg);  // refuses systems that it does not know
    return {values.input,
            values.output,
            values.points,
            values.bytes,
            draco_options(values.encoding),
            ply_options(values.encoding),
            {.precision = values.encoding.precision, .epsg = values.epsg},
            values.common};
}

}  // namespace

CommandReader add_convert(CLI::App& app) {
    const auto shared = std::make_shared<Values>();
    Values& values = *shared;
    CLI::App& command = *app.add_subcommand("convert", "the points as PLY, Draco, stream or COPC");
    add_input(command, values.input);
    command.add_option("OUT", values.output, "a " + std::string(kEndings) + " (COPC) file")
        ->required()
        ->type_name("FILE");
    command.add_option("--points", values.points, "from a .stpc: the first N points")
        ->type_name("N")
        ->transform(point_count());
    command.add_option("--bytes", values.bytes, "from a .stpc: the points in its first B bytes")
        ->type_name("B")
        ->transform(byte_count());
    add_draco(command, values.encoding, ".drc, .laz and .stpc");
    add_ply(command, values.encoding);
    command.add_option("--epsg", values.epsg, "for .laz: coordinate system, such as 32633 (UTM)")
        ->type_name("CODE")
        ->transform(small_number("such as 32633 (UTM)"));
    add_common(command, values.common);
    command.footer(
        "Examples:\n"
        "  stipple convert scan.ply scan.drc --position-bits 16\n"
        "  stipple convert scan.drc scan.ply --ply-encoding ascii\n"
        "  stipple convert scan.ply scan.copc.laz\n"
        "  stipple convert scan.ply scan.stpc\n"
        "  stipple convert scan.stpc first.ply --points 10000");
    return {&command, [shared, &command]() -> Command {
                require_options_of_formats(command, {shared->output});
                return convert_command(*shared);
            }};
}

}  // namespace stipple::cli
