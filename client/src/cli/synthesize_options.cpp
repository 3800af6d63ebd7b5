#include "cli/command_options.hpp"
#include "cli/numbers.hpp"
#include "cli/shared_options.hpp"

#include <memory>
#include <string>

namespace stipple::cli {
namespace {

struct Values {
    std::string output;
    SyntheticScanOptions options;
    EncodingValues encoding;
    CommonOptions common;
};

SynthesizeCommand synthesize_command(const Values& values) {
    format_of(values.output);
    validate(values.options);
    return {values.output, values.options, draco_options(values.encoding),
            ply_options(values.encoding), values.common};
}

}  // namespace

CommandReader add_synthesize(CLI::App& app) {
    const auto shared = std::make_shared<Values>();
    Values& values = *shared;
    CLI::App& command = *app.add_subcommand("synthesize", "a test cloud: an ammonite");
    command.add_option("OUT", values.output, "a .ply or .drc file")->required()->type_name("FILE");
    command.add_option("-n,--points", values.options.points, "exactly this many; default 1000000")
        ->type_name("N")
        ->transform(point_count());
    command
        .add_option("--seed", values.options.seed, "another seed gives other samples; default 1")
        ->type_name("S")
        ->transform(whole_number());
    command.add_option("--noise", values.options.noise, "standard deviation in mm; default 0.08")
        ->type_name("D")
        ->transform(real_number("a length of at least 0, in mm, as in 0.08"));
    add_draco(command, values.encoding);
    add_ply(command, values.encoding);
    add_common(command, values.common);
    command.footer("Example:\n  stipple synthesize ammonite.ply --points 500000 --seed 7");
    return {&command, [shared, &command]() -> Command {
                require_options_of_formats(command, {shared->output});
                return synthesize_command(*shared);
            }};
}

}  // namespace stipple::cli
