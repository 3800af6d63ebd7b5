#include "cli/command_options.hpp"
#include "cli/files.hpp"
#include "cli/numbers.hpp"
#include "cli/shared_options.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace stipple::cli {
namespace {

struct Values {
    std::string pyramid, output, max_error;
    std::optional<std::uint64_t> points, bytes;
    std::vector<std::string> box;
    EncodingValues encoding;
    ServerValues server;
    CommonOptions common;
};

Aabb box_of(const std::vector<std::string>& words) {
    std::vector<double> b;
    for (const std::string& word : words)
        if (const auto value = finite_number(word)) b.push_back(*value);
    if (b.size() != 6 || words.size() != 6)
        throw UsageError("--box: expected six numbers, x0,y0,z0,x1,y1,z1");
    return {Vec3d(b[0], b[1], b[2]), Vec3d(b[3], b[4], b[5])};
}

SliceCommand slice_command(const Values& values) {
    const int budgets = int{values.points.has_value()} + int{values.bytes.has_value()} +
                        int{!values.max_error.empty()};
    if (budgets == 0)
        throw UsageError("how much of it? give --points N, --bytes B or --max-error E");
    if (budgets > 1) throw UsageError("--points, --bytes and --max-error: give one of them");
    SliceCommand command{
        values.pyramid, values.output, {}, server_options(values.server), values.common};
    proto::SliceOptions& options = command.options;
    options.points = values.points;
    options.bytes = values.bytes;
    set_max_error(values.max_error, options);
    if (!values.box.empty()) options.box = box_of(values.box);
    const std::string extension = extension_of(command.output);
    options.format =
        extension == ".glb" ? CloudFormat::Glb : format_of(values.output, ".ply, .drc or .glb");
    options.draco = draco_options(values.encoding);
    validate(options);
    return command;
}

}  // namespace

CommandReader add_slice(CLI::App& app) {
    const auto shared = std::make_shared<Values>();
    Values& values = *shared;
    CLI::App& command =
        *app.add_subcommand("slice", "a cloud cut from a pyramid, by budget and place");
    command
        .add_option("PYRAMID", values.pyramid,
                    "folder by `stipple pyramid`; with --server the id of its job")
        ->required();
    command.add_option("OUT", values.output, "a .ply, .drc or .glb file")
        ->required()
        ->type_name("FILE");
    auto* const budget = command.add_option_group("Budget (give one)");
    budget
        ->add_option("-n,--points", values.points,
                     "exactly this many points, or all if there are fewer")
        ->type_name("N")
        ->transform(point_count());
    budget->add_option("--bytes", values.bytes, "as many points as fit into B bytes, as in 500kB")
        ->type_name("B")
        ->transform(byte_count());
    budget
        ->add_option("--max-error", values.max_error,
                     "the coarsest level within this at the samples that were measured: input "
                     "units, or 0.1% of the diagonal")
        ->type_name("E");
    command
        .add_option("--box", values.box,
                    "only points inside: x0,y0,z0,x1,y1,z1; scalars only with --tile-attributes")
        ->delimiter(',')
        ->expected(1, 6)
        ->type_name("BOX");
    add_draco(command, values.encoding);
    add_server(command, values.server);
    add_common(command, values.common);
    command.footer(
        "Examples:\n"
        "  stipple slice levels/ preview.ply --points 20000\n"
        "  stipple slice levels/ door.glb --bytes 500000 --box 0,0,0,2,1,2.5\n"
        "  stipple slice 0123456789abcdef0123456789abcdef small.drc --max-error 0.05 \\\n"
        "      --server http://127.0.0.1:8080");
    return {&command, [shared, &command]() -> Command {
                require_options_of_formats(command, {shared->output});
                return slice_command(*shared);
            }};
}

}  // namespace stipple::cli
