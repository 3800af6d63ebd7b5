#include "cli/command_options.hpp"
#include "cli/method_options.hpp"
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
    FileValues file;
    std::optional<std::uint64_t> points;
    std::optional<double> ratio;
    std::uint64_t seed = 0;
    std::vector<std::string> reductions;
    AddedValues added;
    std::optional<double> outliers;
    MethodValues of_methods;
};

UpsampleCommand upsample_command(const Values& values) {
    auto command = file_command<proto::UpsampleJob>(values.file);
    command.job.added = added_attributes(values.added);
    command.job.error = !values.added.no_error;
    UpsampleOptions& options = command.job.options;
    options.points = values.points;
    options.ratio = values.ratio;
    if (!values.points && !values.ratio)
        throw UsageError("how many points? give --points N or --ratio R");
    options.particles = particle_options(values.of_methods);
    options.particles.seed = values.seed;
    options.particles.reductions = reductions_of(values.reductions);
    command.job.outliers = outlier_options(values.outliers);
    validate(options);
    return command;
}

}  // namespace

CommandReader add_upsample(CLI::App& app) {
    const auto shared = std::make_shared<Values>();
    Values& values = *shared;
    CLI::App& command = *app.add_subcommand("upsample", "more points on the same surface");
    add_input(command, values.file.input);
    add_output(command, values.file.output);
    command.add_option("-n,--points", values.points, "exactly this many points, more than IN has")
        ->type_name("N")
        ->transform(point_count());
    command.add_option("-r,--ratio", values.ratio, "this many times the points, above 1")
        ->type_name("R")
        ->transform(real_number("a factor above 1, as in 2"));
    add_particle_options(command, values.of_methods);
    command.add_option("--seed", values.seed, "another seed gives other points")
        ->type_name("S")
        ->capture_default_str()
        ->transform(whole_number());
    add_reductions(command, values.reductions);
    add_remove_outliers(command, values.outliers);
    add_added_attributes(command, values.added);
    add_encoding(command, values.file);
    command.footer(
        "Examples:\n"
        "  stipple upsample scan.ply dense.ply --ratio 4\n"
        "  stipple upsample scan.ply dense.drc --points 1000000");
    return {&command, [shared, &command]() -> Command {
                require_options_of_formats(command, {shared->file.output});
                return upsample_command(*shared);
            }};
}

}  // namespace stipple::cli
