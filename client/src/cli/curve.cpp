#include "cli/commands.hpp"
#include "cli/curve_plot.hpp"
#include "cli/files.hpp"
#include "cli/job_execution.hpp"
#include "cli/report.hpp"
#include "cli/units.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <iostream>
#include <string>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

ordered_json figures(const CurveCommand& command, const proto::Results& results) {
    ordered_json json;
    json["input"] = input_json(command.input, *results.source);
    json["method"] = to_string(*proto::method_of(results.request));
    json["diagonal"] = results.levels.front().curve->diagonal;
    json["curve"] = ordered_json::array();
    for (const proto::OutputCloud& level : results.levels) {
        ordered_json point = {{"points", level.points}};
        point.update(ordered_json::parse(proto::to_json(*level.curve)));
        point.erase("diagonal");  // the same of all: it stands once
        json["curve"].push_back(std::move(point));
    }
    if (results.cost) add_cost(json, *results.cost);
    return json;
}

/// Counts that were asked for and that the cloud has not more points than; empty when there are
/// none.
std::string left_out_line(const CurveCommand& command, const proto::Results& results) {
    std::vector<std::string> counts;
    for (const std::uint64_t count : command.job.options.points) {
        if (std::ranges::find(results.levels, count, &proto::OutputCloud::points) ==
            results.levels.end())
            counts.push_back(with_separators(count));
    }
    if (counts.empty()) return {};
    const proto::CloudStatistics& source = *results.source;
    return "left out " + joined(counts, ", ") + ": the cloud has " +
           counted(source.points - source.removed(), "point");
}

/// In 10^-4 of the diagonal, as the paper has it.
std::string table(const proto::Results& results, const TextStyle& style) {
    std::string text = style.dim("    points      max      rms     mean") + "\n";
    for (const proto::OutputCloud& level : results.levels) {
        const proto::CurveError& error = *level.curve;
        const double unit = error.diagonal > 0 ? 1e4 / error.diagonal : 0;
        std::array<char, 96> line{};
        std::snprintf(line.data(), line.size(), "%10s %8.2f %8.2f %8.2f\n",
                      with_separators(level.points).c_str(),
                      unit * std::max(error.forward.max, error.backward.max),
                      unit * error.forward.rms, unit * error.forward.mean);
        text += line.data();
    }
    return text +
           style.dim("max of both directions, rms and mean from the input: 1e-4 of the diagonal") +
           "\n";
}

}  // namespace

void run(const CurveCommand& command, const Session& session) {
    require_files({command.input}, {command.plot, command.common.json});
    const ScratchFolder scratch(command.plot.empty() ? temporary_folder()
                                                     : folder_of(command.plot));
    ProgressDisplay display(session.terminal, !command.common.quiet);
    const JobExecution execution{command.server, command.common.threads, session.stop};
    proto::Results results = naming(command.input, [&] {
        return execute({{}, command.job}, command.input, scratch.path(), execution, display);
    });
    std::ranges::sort(results.levels, {}, &proto::OutputCloud::points);
    if (!command.plot.empty()) {
        const std::string title =
            command.input.filename().string() + ", " + with_separators(results.source->points) +
            " points: " + std::string(to_string(*proto::method_of(results.request)));
        write_text(command.plot, curve_plot(results.levels, title));
    }
    display.finish();
    const TextStyle& style = session.terminal.style();
    if (const std::string left_out = left_out_line(command, results);
        !command.common.quiet && !left_out.empty())
        std::cerr << style.dim(left_out) << '\n';
    if (!command.common.quiet && command.common.json != "-")
        write_out(table(results, session.terminal.output_style()));
    write_json(command.common.json, figures(command, results));
}

}  // namespace stipple::cli
