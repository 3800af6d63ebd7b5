#include "cli/command_options.hpp"
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
    FileValues file;
    std::string method{to_string(SimplifyOptions{}.method)};
    std::optional<std::uint64_t> points;
    std::optional<double> ratio;
    std::string max_error;
    std::uint64_t seed = 0;
    std::vector<std::string> reductions;
    AddedValues added;
    std::optional<double> outliers;
    MethodValues of_methods;
};

std::string methods() {
    std::string names;
    for (const Method method : kMethods)
        names += (names.empty() ? "" : ", ") + std::string(to_string(method));
    return names;
}

/// What says how many points a method leaves.
std::string targets_of(Method method) {
    if (method == Method::Voxel) return "--points N, --ratio R or --voxel-size S";
    if (method == Method::Incremental) return "--points N, --ratio R or --max-cluster-size N";
    if (method == Method::Hierarchical)
        return "--points N, --ratio R, --max-error E, or --max-cluster-size N and --max-variation "
               "S";
    const bool bounded =
        std::ranges::find(kErrorBoundedMethods, method) != kErrorBoundedMethods.end();
    return bounded ? "--points N, --ratio R or --max-error E" : "--points N or --ratio R";
}

SimplifyCommand simplify_command(const Values& values, const CLI::App& app) {
    auto command = file_command<proto::SimplifyJob>(values.file);
    command.job.added = added_attributes(values.added);
    command.job.error = !values.added.no_error;
    SimplifyOptions& options = command.job.options;
    options.method = method_from_name(values.method);
    refuse_options_of_other_methods(app, options.method);
    options.points = values.points;
    options.ratio = values.ratio;
    set_max_error(values.max_error, options);
    set_method_options(values.of_methods, options);
    options.reductions = reductions_of(values.reductions);
    options.seed = values.seed;
    command.job.outliers = outlier_options(values.outliers);
    const MethodValues& own = values.of_methods;
    if (!values.points && !values.ratio && values.max_error.empty() && !own.max_cluster_size &&
        !own.max_variation && !own.voxel_size)
        throw UsageError("how many points? give " + targets_of(options.method));
    const bool bounded = own.max_cluster_size || own.voxel_size ||
                         (own.max_variation && options.method != Method::Incremental);
    if (int{values.points.has_value()} + int{values.ratio.has_value()} +
            int{!values.max_error.empty()} + int{bounded} >
        1)
        throw UsageError(targets_of(options.method) + ": give one of them");
    validate(options);
    return command;
}

}  // namespace

CommandReader add_simplify(CLI::App& app) {
    const auto shared = std::make_shared<Values>();
    Values& values = *shared;
    CLI::App& command = *app.add_subcommand("simplify", "fewer points, the same surface");
    add_input(command, values.file.input);
    add_output(command, values.file.output);
    command.add_option("-m,--method", values.method, methods())
        ->type_name("M")
        ->capture_default_str();
    command
        .add_option("-n,--points", values.points, "exactly this many points: 5000, 10k, 1.5M, 1e6")
        ->type_name("N")
        ->transform(point_count("--ratio"));
    command
        .add_option("-r,--ratio", values.ratio, "this fraction of the points, in (0, 1], or 10%")
        ->type_name("R")
        ->transform(share());
    command
        .add_option("--max-error", values.max_error,
                    "as few points as are found within this distance: input units, or 0.1% of the "
                    "diagonal")
        ->type_name("E");
    add_seed(command, values.seed);
    add_reductions(command, values.reductions);
    add_remove_outliers(command, values.outliers);
    add_added_attributes(command, values.added);
    add_encoding(command, values.file);
    add_method_options(command, values.of_methods, kMethods);
    command.footer(
        "Examples:\n"
        "  stipple simplify scan.ply small.ply --points 5000\n"
        "  stipple simplify scan.ply small.drc --ratio 0.01 --precision 0.001\n"
        "  stipple simplify scan.ply small.ply --max-error 0.1%\n"
        "  stipple simplify scan.ply small.ply -m iterative -n 5000 --color-weight 0.01\n"
        "  stipple simplify scan.ply small.ply -m hierarchical --max-variation 0.02\n"
        "  stipple simplify scan.ply even.ply -m particles -n 5000 \\\n"
        "      --region sphere:0,0,0,1:4\n"
        "  stipple simplify scan.ply small.drc -n 5000 --server http://127.0.0.1:8080");
    return {&command, [shared, &command]() -> Command {
                require_options_of_formats(command, {shared->file.output});
                return simplify_command(*shared, command);
            }};
}

}  // namespace stipple::cli
