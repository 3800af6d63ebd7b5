#include "cli/command_options.hpp"
#include "cli/files.hpp"
#include "cli/names.hpp"
#include "cli/numbers.hpp"
#include "cli/shared_options.hpp"
#include "cli/text.hpp"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace stipple::cli {
namespace {

struct Values {
    std::string reference;
    std::vector<std::string> candidates, maps;
    proto::EvaluationOptions options;
    std::string sampling = "points", basis, up = "y";
    EncodingValues encoding;
    ServerValues server;
    CommonOptions common;
};

constexpr std::size_t kMostOfLabel = 200;  // bytes, as `proto::EvaluationOptions` takes them

EvaluateCommand evaluate_command(const Values& values) {
    EvaluateCommand command{values.reference,
                            {},
                            {},
                            {values.maps.begin(), values.maps.end()},
                            server_options(values.server),
                            values.common};
    proto::EvaluationOptions& options = command.job.options;
    options = values.options;
    options.measure.sampling =
        named("--sampling", values.sampling, proto::error_sampling_from_name);
    if (!values.basis.empty())
        options.measure.surface = named("--basis", values.basis, proto::error_surface_from_name);
    if (values.candidates.size() > proto::kMostCandidates)
        throw UsageError(std::to_string(values.candidates.size()) + " candidates: at most " +
                         std::to_string(proto::kMostCandidates));
    for (const std::string& candidate : values.candidates) {
        command.candidates.emplace_back(candidate);
        options.labels.push_back(
            shortened(printable(command.candidates.back().filename().string()), kMostOfLabel));
    }
    if (values.up.size() != 1) throw UsageError("--up " + values.up + ": expected x, y or z");
    options.up = values.up.front();
    for (const std::filesystem::path& map : command.maps) {
        if (extension_of(map) == ".png") {
            options.pictures = true;
            continue;
        }
        std::vector<CloudFormat>& formats = command.job.output.formats;
        const CloudFormat format = format_of(map, ".ply, .drc or .png");
        if (std::find(formats.begin(), formats.end(), format) == formats.end())
            formats.push_back(format);
    }
    command.job.output.draco = draco_options(values.encoding);
    validate(options);
    return command;
}

}  // namespace

CommandReader add_evaluate(CLI::App& app) {
    const auto shared = std::make_shared<Values>();
    Values& values = *shared;
    proto::EvaluationOptions& options = values.options;
    CLI::App& command =
        *app.add_subcommand("evaluate", "how far a cloud's surface is from another's");
    command
        .add_option("REFERENCE", values.reference, "the reference cloud: PLY, Draco or progressive")
        ->required()
        ->type_name("FILE");
    command.add_option("CANDIDATE", values.candidates, "clouds to compare with it")
        ->required()
        ->type_name("FILE");
    command
        .add_option(
            "--map", values.maps,
            "write the reference coloured by distance (.ply, .drc) or pictures of it (.png)")
        ->type_name("OUT")
        ->allow_extra_args(false);
    command
        .add_option(
            "--samples", options.measure.samples,
            "samples on each surface; 0: 40000, or one per point, and the maximum over all points")
        ->type_name("N")
        ->capture_default_str()
        ->transform(point_count());
    command
        .add_option("--sampling", values.sampling,
                    "places: points, surface (random) or particles (as in the paper)")
        ->type_name("S")
        ->capture_default_str();
    command
        .add_option("--basis", values.basis,
                    "surface: linear (default), quadratic, or samples (the points alone)")
        ->type_name("B");
    command.add_option("--k", options.measure.k, "neighbours that define the surface, 6..64")
        ->type_name("K")
        ->capture_default_str()
        ->transform(small_number("6..64"));
    command.add_option("--seed", options.measure.seed, "another seed gives other samples")
        ->type_name("S")
        ->capture_default_str()
        ->transform(whole_number());
    command.add_flag("--attributes", options.measure.attributes,
                     "compare colours, normals and scalars, too, smoothed like\n"
                     "the surface: over 20 neighbours");
    command.add_option("--range", options.range, "distance of the last colour; chosen by default")
        ->type_name("MAX")
        ->transform(real_number("a distance above 0, in input units, as in 0.5"));
    command
        .add_option("--views", options.views,
                    "for .png: any of front,right,back,left (default), top, bottom")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->type_name("V,V");
    command.add_option("--up", values.up, "axis that points up in pictures: x, y or z")
        ->type_name("A")
        ->capture_default_str();
    add_draco(command, values.encoding);
    add_server(command, values.server);
    add_common(command, values.common);
    command.footer(
        "Examples:\n"
        "  stipple evaluate scan.ply small.ply\n"
        "  stipple evaluate scan.ply a.ply b.drc --json errors.json --map errors.png\n"
        "  stipple evaluate scan.ply small.ply --map errors.ply --range 0.5");
    return {&command, [shared, &command]() -> Command {
                require_options_of_formats(command, shared->maps);
                return evaluate_command(*shared);
            }};
}

}  // namespace stipple::cli
