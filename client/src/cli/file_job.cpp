#include "cli/commands.hpp"
#include "cli/files.hpp"
#include "cli/job_execution.hpp"
#include "cli/report.hpp"
#include "cli/text.hpp"
#include "cli/units.hpp"
#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"

#include <chrono>
#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <variant>
#include <vector>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

/// Jobs write PLY in little endian; another encoding of the same cloud is made of that.
void change_encoding(const fs::path& file, const PlyEncodeOptions& options,
                     proto::OutputFile& output, const RunContext& context) {
    write_cloud(read_cloud(file, limits_here(), context), file, options, {}, {}, context);
    output.bytes = fs::file_size(file);
    output.sha256 = proto::sha256_of_file(file);
}

/// What the user should know of a result that is not what was asked for.
template <typename Job>
std::vector<std::string> warnings_of(const FileCommand<Job>& command,
                                     const proto::OutputCloud& cloud) {
    std::vector<std::string> warnings;
    if constexpr (requires { command.job.options.points; }) {
        if (command.job.options.points > cloud.points)
            warnings.push_back(with_separators(*command.job.options.points) +
                               " points were requested; the cloud has only " +
                               with_separators(cloud.points));
    }
    return warnings;
}

template <typename Job>
ordered_json figures(const FileCommand<Job>& command, const proto::Results& results) {
    const proto::OutputCloud& cloud = results.levels.front();
    const proto::OutputFile& file = cloud.files.front();
    ordered_json json;
    json["input"] = input_json(command.input, *results.source);
    json["output"] = {{"points", cloud.points},
                      {"file", command.output.string()},
                      {"format", to_string(file.format)},
                      {"bytes", file.bytes},
                      {"sha256", file.sha256},
                      {"spacing", cloud.spacing},
                      {"bounds", bounds_json(cloud.bounds)}};
    if (cloud.bound) json["bound"] = ordered_json::parse(proto::to_json(*cloud.bound));
    if (const auto method = proto::method_of(results.request)) json["method"] = to_string(*method);
    if (cloud.error) json["error"] = ordered_json::parse(proto::to_json(*cloud.error));
    if (file.error)
        json["output"]["error"] = {{"mean", file.error->mean}, {"max", file.error->max}};
    if (const auto warnings = warnings_of(command, cloud); !warnings.empty())
        json["warnings"] = warnings;
    if (results.cost) add_cost(json, *results.cost);
    return json;
}

/// Of the grid of its Draco file, as its error tells, where that was measured; 0: not known.
double step_of(const proto::OutputCloud& cloud) {
    const auto& with = cloud.files.front().error;
    if (!with || !cloud.error) return 0;
    return (with->max - cloud.error->error.max()) / (0.5 * std::sqrt(3.0));
}

template <typename Job>
void summarise(const FileCommand<Job>& command, const proto::Results& results, double seconds,
               const Terminal& terminal) {
    const proto::OutputCloud& cloud = results.levels.front();
    const TextStyle& style = terminal.style();
    print_line(summary_line({results.source->points, cloud.points, fs::file_size(command.input),
                             cloud.files.front().bytes, seconds},
                            style),
               terminal);
    if (cloud.error) print_line(style.dim(error_line(*cloud.error, style)), terminal);
    if (cloud.bound) print_line(bound_line(*cloud.bound, cloud.points, style), terminal);
    if (cloud.files.front().format == CloudFormat::Draco)
        if (const std::string line =
                draco_line(cloud.origin.value_or(Vec3d::Zero()), step_of(cloud), style);
            !line.empty())
            print_line(style.dim(line), terminal);
    const std::string losses = losses_line(*results.source, style);
    if (!losses.empty()) print_line(style.dim(losses), terminal);
    for (const std::string& warning : warnings_of(command, cloud)) print_line(warning, terminal);
    if (cloud.error) print_warnings(*cloud.error, command.output, terminal);
}

/// Does nothing with what a job made beside its first cloud.
void ignore(const proto::Results&, const fs::path&, ordered_json&, const RunContext&) {}

/// @param also  is called with the results, the folder of their files and the figures, before the
/// output stands in its place.
template <typename Job, typename Also>
void run_file_job(const FileCommand<Job>& command, const Session& session, Also&& also) {
    const auto start = std::chrono::steady_clock::now();
    const ScratchFolder scratch(folder_of(command.output));
    ProgressDisplay display(session.terminal, !command.common.quiet);
    const JobExecution execution{command.server, command.common.threads, session.stop};
    const RunContext context = context_of(command.common, session);
    proto::Results results = naming(command.input, [&] {
        return execute({{}, command.job}, command.input, scratch.path(), execution, display);
    });

    proto::OutputFile& output = first_output(results);
    const fs::path file = scratch.path() / output.href;
    if (output.format == CloudFormat::Ply &&
        command.ply.encoding != PlyEncoding::BinaryLittleEndian)
        change_encoding(file, command.ply, output, context);
    ordered_json json = figures(command, results);
    also(results, scratch.path(), json, context);
    move_into_place(file, command.output);
    display.finish();

    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    if (!command.common.quiet) summarise(command, results, took.count(), session.terminal);
    write_json(command.common.json, json);
}

/// The feature lines are the second cloud of an analysis, when there are any.
PointCloud write_feature_lines(const AnalyzeCommand& command, const proto::Results& results,
                               const fs::path& folder, ordered_json& json,
                               const RunContext& context) {
    PointCloud lines;
    if (results.levels.size() > 1)
        lines = read_cloud(folder / results.levels[1].files.front().href, limits_here(), context);
    write_cloud_into_place(lines, command.feature_lines, command.ply, command.job.output.draco, {},
                           context);
    json["feature_lines"] = {{"points", lines.size()}, {"file", command.feature_lines.string()}};
    return lines;
}

/// How many lines there are, by the number of its line that each point has.
std::size_t count_lines(const PointCloud& points) {
    const Attribute* const numbers = find_attribute(points, "line");
    if (numbers == nullptr) return 0;
    return std::visit(
        [](const auto& values) { return std::set<double>(values.begin(), values.end()).size(); },
        numbers->values);
}

std::string feature_line(const PointCloud& lines, const AnalyzeCommand& command) {
    const std::string file = printable(command.feature_lines.filename().string());
    if (lines.empty())
        return "no feature lines were found: " + file +
               " has no points; a smaller --feature-variation may find some";
    return counted(count_lines(lines), "feature line") + " of " + counted(lines.size(), "point") +
           ": " + file;
}

}  // namespace

void run(const SimplifyCommand& command, const Session& session) {
    require_files({command.input}, {command.output, command.common.json});
    run_file_job(command, session, ignore);
}

void run(const UpsampleCommand& command, const Session& session) {
    require_files({command.input}, {command.output, command.common.json});
    run_file_job(command, session, ignore);
}

void run(const AnalyzeCommand& command, const Session& session) {
    const bool wanted = !command.feature_lines.empty();
    PointCloud lines;
    require_files({command.input}, {command.output, command.feature_lines, command.common.json});
    run_file_job(command, session,
                 [&](const auto& results, const fs::path& folder, auto& json, const auto& context) {
                     if (wanted)
                         lines = write_feature_lines(command, results, folder, json, context);
                 });
    if (wanted && !command.common.quiet)
        print_line(session.terminal.style().dim(feature_line(lines, command)), session.terminal);
}

}  // namespace stipple::cli
