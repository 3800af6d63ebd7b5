#include "cli/command_options.hpp"
#include "cli/method_options.hpp"
#include "cli/names.hpp"
#include "cli/numbers.hpp"
#include "cli/shared_options.hpp"
#include "stipple/proto/option_names.hpp"

#include <memory>
#include <optional>
#include <string>

namespace stipple::cli {
namespace {

struct Values {
    FileValues file;
    SurfaceAttributeOptions surface;
    std::string orient = "mst", viewpoint, feature_lines;
    FeatureLineOptions features;
    std::optional<double> outliers;
};

AnalyzeCommand analyze_command(const Values& values) {
    AnalyzeCommand command{file_command<proto::AnalyzeJob>(values.file), values.feature_lines};
    SurfaceAttributeOptions& options = command.job.options;
    options = values.surface;
    options.signs = named("--orient", values.orient, proto::normal_signs_from_name);
    if (options.signs == NormalSigns::Viewpoint)
        throw UsageError("--orient viewpoint: give --viewpoint X,Y,Z instead");
    if (!values.viewpoint.empty()) {
        options.signs = NormalSigns::Viewpoint;
        options.viewpoint = read_position(values.viewpoint, "--viewpoint");
    }
    if (!values.feature_lines.empty()) {
        format_of(values.feature_lines);
        options.feature_lines = values.features;
    }
    command.job.outliers = outlier_options(values.outliers);
    validate(options);
    return command;
}

}  // namespace

CommandReader add_analyze(CLI::App& app) {
    const auto shared = std::make_shared<Values>();
    Values& values = *shared;
    CLI::App& command =
        *app.add_subcommand("analyze", "normals, variation, density and anisotropy");
    add_input(command, values.file.input);
    add_output(command, values.file.output);
    command
        .add_option("--k", values.surface.k,
                    "neighbours, 3..64; 0: chosen for each point, by noise and curvature")
        ->type_name("K")
        ->capture_default_str()
        ->transform(small_number("3..64, or 0: chosen for each point"));
    auto* const orient =
        command.add_option("--orient", values.orient, "signs of the normals: mst or none")
            ->type_name("O")
            ->capture_default_str();
    command
        .add_option("--viewpoint", values.viewpoint,
                    "orient the normals towards this point instead")
        ->type_name("X,Y,Z")
        ->excludes(orient);
    auto* const lines =
        command
            .add_option("--feature-lines", values.feature_lines,
                        "write the points of creases to FILE, and their weight to OUT")
            ->type_name("FILE");
    command
        .add_option("--feature-variation", values.features.variation,
                    "surface variation of a crease, in (0, 1/3)")
        ->type_name("S")
        ->capture_default_str()
        ->transform(real_number("a number in (0, 1/3), as in 0.05"))
        ->needs(lines);
    add_remove_outliers(command, values.outliers);
    add_encoding(command, values.file);
    command.footer(
        "Examples:\n"
        "  stipple analyze scan.ply analyzed.ply\n"
        "  stipple analyze scan.ply analyzed.ply --k 24 --viewpoint 0,0,10\n"
        "  stipple analyze scan.ply analyzed.ply --feature-lines creases.ply");
    return {&command, [shared, &command]() -> Command {
                std::vector<std::string> outputs = {shared->file.output};
                if (!shared->feature_lines.empty()) outputs.push_back(shared->feature_lines);
                require_options_of_formats(command, outputs);
                return analyze_command(*shared);
            }};
}

}  // namespace stipple::cli
