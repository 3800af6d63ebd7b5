#include "cli/command_options.hpp"
#include "cli/files.hpp"
#include "cli/method_options.hpp"
#include "cli/numbers.hpp"
#include "cli/shared_options.hpp"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace stipple::cli {
namespace {

struct Values {
    std::string input, plot;
    std::string method{to_string(ErrorCurveOptions{}.simplification.method)};
    std::vector<std::uint64_t> points;
    unsigned count = ErrorCurveOptions{}.count;
    std::uint64_t seed = 0;
    std::optional<double> outliers;
    ServerValues server;
    CommonOptions common;
    MethodValues of_methods;
};

CurveCommand curve_command(const Values& values, const CLI::App& app) {
    CurveCommand command{
        values.input, values.plot, {}, server_options(values.server), values.common};
    if (!values.plot.empty() && extension_of(command.plot) != ".svg")
        throw UsageError(values.plot + ": the name must end with .svg");
    ErrorCurveOptions& options = command.job.options;
    options.simplification.method = method_from_name(values.method);
    refuse_options_of_other_methods(app, options.simplification.method);
    set_method_options(values.of_methods, options.simplification);
    options.simplification.seed = values.seed;
    options.points = values.points;
    std::ranges::sort(options.points);
    options.count = values.count;
    command.job.outliers = outlier_options(values.outliers);
    validate(options);
    return command;
}

}  // namespace

CommandReader add_curve(CLI::App& app) {
    const auto shared = std::make_shared<Values>();
    Values& values = *shared;
    CLI::App& command = *app.add_subcommand("curve", "how the error grows with fewer points");
    add_input(command, values.input);
    command
        .add_option("-m,--method", values.method,
                    "multiphase, hierarchical, iterative or particles")
        ->type_name("M")
        ->capture_default_str();
    auto* const points =
        command.add_option("-n,--points", values.points, "at these counts, as in 1000,5000,20k")
            ->delimiter(',')
            ->type_name("A,B,C")
            ->transform(point_count());
    command
        .add_option("--count", values.count,
                    "number of counts, from half of the points (at most a million) to a "
                    "thousandth, 2..64")
        ->type_name("K")
        ->capture_default_str()
        ->excludes(points)
        ->transform(small_number("2..64"));
    command.add_option("--plot", values.plot, "plot it as a .svg file")->type_name("FILE");
    add_seed(command, values.seed);
    add_remove_outliers(command, values.outliers);
    add_server(command, values.server);
    add_common(command, values.common);
    add_method_options(command, values.of_methods, kErrorBoundedMethods);
    hide(command, {"--max-cluster-size", "--max-variation"});
    command.footer(
        "Counts are stages of one run where a method allows it; with multiphase,\n"
        "simplify to one of them alone may have half or twice the error.\n\n"
        "Examples:\n"
        "  stipple curve scan.ply --plot curve.svg\n"
        "  stipple curve scan.ply -m iterative --points 1000,5000,20k --json curve.json");
    return {&command, [shared, &command] { return curve_command(*shared, command); }};
}

}  // namespace stipple::cli
