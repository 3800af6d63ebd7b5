#include "cli/commands.hpp"
#include "cli/files.hpp"
#include "cli/job_execution.hpp"
#include "cli/report.hpp"
#include "cli/text.hpp"
#include "cli/units.hpp"
#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/problem.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <numeric>
#include <ranges>
#include <span>
#include <sstream>
#include <utility>
#include <vector>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

/// A histogram in block characters: the shares of the area in bins from 0 to the maximum.
std::string blocks(const std::vector<double>& shares, std::size_t columns, bool unicode) {
    static constexpr std::array kUnicode = {" ", "▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};
    static constexpr std::array kAscii = {" ", ".", ".", ":", ":", "+", "+", "#", "#"};
    std::vector<double> bars(columns);
    for (std::size_t i = 0; i < shares.size(); ++i) bars[i * columns / shares.size()] += shares[i];
    const double highest = *std::ranges::max_element(bars);
    std::string text;
    for (const double bar : bars) {
        // What is there at all is seen.
        const auto step = bar > 0
                              ? std::clamp<std::size_t>(
                                    static_cast<std::size_t>(std::lround(8 * bar / highest)), 1, 8)
                              : 0;
        text += unicode ? kUnicode[step] : kAscii[step];
    }
    return text;
}

/// What attributes are compared in.
constexpr const char* kAttributeUnits =
    "differences of color are CIEDE2000, of normal radians, else as they are";

/// A column of a table: its title, then its cells; where they are figures, the least is the best.
struct Column {
    std::vector<std::string> cells;
    std::vector<double> figures{};
    std::size_t width = 0;

    explicit Column(std::vector<std::string> cells_, std::vector<double> figures_ = {})
        : cells(std::move(cells_)),
          figures(std::move(figures_)),
          width(std::ranges::max(cells | std::views::transform(display_width))) {}
};

constexpr std::size_t kGap = 2, kShortestName = 12;  // of columns, and the part of a name kept

std::size_t width_of(std::span<const Column> columns) {
    return std::accumulate(columns.begin(), columns.end(), std::size_t{0},
                           [](std::size_t sum, const Column& c) { return sum + kGap + c.width; });
}

/// What is least of a column is set in bold. Names are cut where lines are too short.
void print_columns(std::ostream& out, const Column& names, std::span<const Column> right,
                   const TextStyle& style, std::size_t columns) {
    const std::size_t width = width_of(right);
    const std::size_t left =
        std::min(names.width, std::max(kShortestName, columns > width ? columns - width : 0));
    std::vector<std::string> rows;
    for (const std::string& name : names.cells)
        rows.push_back(in_left(cut_amid(name, left, style.unicode), left));
    for (const Column& c : right) {
        for (std::size_t i = 0; i < rows.size(); ++i) {
            const std::string text = in_right(c.cells[i], c.width + kGap);
            const bool best =
                i > 0 && !c.figures.empty() && c.figures[i - 1] <= std::ranges::min(c.figures);
            rows[i] += best ? style.strong(text) : text;
        }
    }
    out << style.dim(rows.front()) << '\n';
    for (std::size_t i = 1; i < rows.size(); ++i) out << rows[i] << '\n';
}

/// All that is known of one candidate, in both directions.
void print(std::ostream& out, const proto::OutputCloud& cloud, const TextStyle& style,
           std::size_t columns) {
    const SurfaceError& error = cloud.error->error;
    const DirectedError &forward = error.forward, &backward = error.backward;
    std::vector<std::string> names = {""}, there = {"reference to candidate"},
                             back = {"candidate to reference"};
    const auto row = [&](std::string name, std::string of_forward, std::string of_backward) {
        names.push_back(std::move(name));
        there.push_back(std::move(of_forward));
        back.push_back(std::move(of_backward));
    };
    const auto figure = [&](const char* name, double DirectedError::*field) {
        row(name, distance_text(forward.*field, error), distance_text(backward.*field, error));
    };
    figure("mean", &DirectedError::mean);
    figure("rms", &DirectedError::rms);
    figure("p50", &DirectedError::p50);
    figure("p95", &DirectedError::p95);
    figure("p99", &DirectedError::p99);
    figure("max", &DirectedError::max);
    const auto cover = [&](const DirectedError& direction) {
        return direction.cover_radius ? distance_text(*direction.cover_radius, error) : "";
    };
    if (forward.cover_radius || backward.cover_radius)
        row("to a point", cover(forward), cover(backward));
    row("0 .. max", blocks(forward.histogram, 20, style.unicode),
        blocks(backward.histogram, 20, style.unicode));
    row("samples", with_separators(forward.samples), with_separators(backward.samples));
    const auto difference = [](const AttributeError& a) {
        const std::string text = three_digits(a.mean) + " (max " + three_digits(a.max) + ")";
        return a.differing ? text + ", " + three_digits(100 * *a.differing) + " % differ" : text;
    };
    for (const AttributeError& a : forward.attributes) {
        const auto of_back = std::ranges::find(backward.attributes, a.name, &AttributeError::name);
        row(printable(a.name), difference(a),
            of_back == backward.attributes.end() ? "" : difference(*of_back));
    }
    const std::array right = {Column(std::move(there)), Column(std::move(back))};
    print_columns(out, Column(std::move(names)), right, style, columns);
    const bool is_forward = forward.max >= backward.max;
    const DirectedError& larger = is_forward ? forward : backward;
    if (larger.max_at && larger.max > 0)
        out << "max at " << readable_place(*larger.max_at, larger.max)
            << (is_forward ? ", on the reference" : ", on the candidate") << '\n';
    out << style.dim("input units, and percent of the diagonal, " + three_digits(error.diagonal))
        << '\n';
    if (!forward.attributes.empty()) out << style.dim(kAttributeUnits) << '\n';
}

/// A column for the mean difference of each attribute of any candidate.
std::vector<Column> attribute_columns(const std::vector<proto::OutputCloud>& levels) {
    std::vector<std::string> names;
    for (const proto::OutputCloud& cloud : levels)
        for (const AttributeError& a : cloud.error->error.forward.attributes)
            if (std::ranges::find(names, a.name) == names.end()) names.push_back(a.name);
    std::vector<Column> columns;
    for (const std::string& name : names) {
        std::vector<std::string> cells = {printable(name)};
        std::vector<double> means;
        for (const proto::OutputCloud& cloud : levels) {
            const auto& all = cloud.error->error.forward.attributes;
            const auto found = std::ranges::find(all, name, &AttributeError::name);
            const bool is_there = found != all.end();
            cells.push_back(is_there ? three_digits(found->mean) : "");
            means.push_back(is_there ? found->mean : std::numeric_limits<double>::infinity());
        }
        columns.emplace_back(std::move(cells), std::move(means));
    }
    return columns;
}

/// A row for each candidate. Where lines of so many columns are too short the rms is left out, and
/// attributes go on in further tables.
void print_table(std::ostream& out, const EvaluateCommand& command, const proto::Results& results,
                 const TextStyle& style, std::size_t columns) {
    const auto& levels = results.levels;
    std::vector<std::string> files = {"candidate"}, points = {"points"};
    for (std::size_t i = 0; i < levels.size(); ++i) {
        files.push_back(printable(command.candidates[i].filename().string()));
        points.push_back(with_separators(levels[i].points));
    }
    const Column names(std::move(files));
    const auto figures = [&](const char* name, double (SurfaceError::*of)() const noexcept) {
        std::vector<std::string> cells = {name};
        std::vector<double> values;
        for (const proto::OutputCloud& cloud : levels) {
            values.push_back((cloud.error->error.*of)());
            cells.push_back(distance_text(values.back(), cloud.error->error));
        }
        return Column(std::move(cells), std::move(values));
    };
    std::vector<Column> right = {Column(std::move(points)), figures("mean", &SurfaceError::mean),
                                 figures("rms", &SurfaceError::rms),
                                 figures("max", &SurfaceError::max)};
    constexpr std::ptrdiff_t kRms = 2;
    const bool has_rms = names.width + width_of(right) <= columns;
    if (!has_rms) right.erase(right.begin() + kRms);
    print_columns(out, names, right, style, columns);
    out << style.dim(std::string("mean") + (has_rms ? " and rms" : "") +
                     " from the reference to the candidate, max of both ways;\n"
                     "input units, and percent of the diagonal, " +
                     three_digits(levels.front().error->error.diagonal))
        << '\n';

    const std::vector<Column> attributes = attribute_columns(levels);
    for (std::span<const Column> rest = attributes; !rest.empty();) {
        std::size_t fitting = 1;
        const std::size_t left = std::min(names.width, std::max(kShortestName, columns / 3));
        while (fitting < rest.size() && left + width_of(rest.first(fitting + 1)) <= columns)
            ++fitting;
        print_columns(out, names, rest.first(fitting), style, columns);
        rest = rest.subspan(fitting);
    }
    if (!attributes.empty()) out << style.dim(std::string("mean ") + kAttributeUnits) << '\n';
}

void summarise(const EvaluateCommand& command, const proto::Results& results, double seconds,
               const Terminal& terminal) {
    const TextStyle& style = terminal.output_style();
    const bool one = results.levels.size() == 1;
    std::ostringstream out;
    out << style.strong(counted(results.source->remaining(), "point") + " against " +
                        (one ? counted(results.levels.front().points, "point")
                             : counted(results.levels.size(), "candidate")))
        << " in " << readable_seconds(seconds) << '\n';
    if (one)
        print(out, results.levels.front(), style, terminal.output_columns());
    else
        print_table(out, command, results, style, terminal.output_columns());
    const auto& job = std::get<proto::EvaluateJob>(results.request.job);
    if (std::ranges::find(job.candidates, results.request.input) != job.candidates.end() &&
        job.options.measure.surface != ErrorSurface::Samples)
        out << style.dim(
                   "a cloud compared with itself: its surface between the points is not known\n"
                   "more precisely than this; --basis samples uses the points alone")
            << '\n';
    const auto lies_on_candidate = [](const proto::OutputCloud& cloud) {
        constexpr double kMuch = 2;
        const SurfaceError& error = cloud.error->error;
        return error.backward.max > kMuch * error.forward.max;
    };
    if (!command.maps.empty() && std::ranges::any_of(results.levels, lies_on_candidate))
        out << style.dim(
                   "a map shows the reference, and the largest distance lies on a candidate:\n"
                   "swap the clouds to see it")
            << '\n';
    write_out(out.str());
    for (std::size_t i = 0; i < results.levels.size(); ++i)
        print_warnings(*results.levels[i].error, command.candidates[i], terminal);
}

/// Where the map of a candidate goes: `errors.ply`, or `errors-2.ply` when there are several.
fs::path numbered(const fs::path& file, std::size_t candidate, std::size_t all) {
    if (all == 1) return file;
    return file.parent_path() /
           (file.stem().string() + "-" + std::to_string(candidate + 1) + file.extension().string());
}

std::vector<fs::path> inputs_of(const EvaluateCommand& command) {
    std::vector<fs::path> inputs = {command.reference};
    inputs.insert(inputs.end(), command.candidates.begin(), command.candidates.end());
    return inputs;
}
std::vector<fs::path> outputs_of(const EvaluateCommand& command) {
    std::vector<fs::path> outputs = {command.common.json};
    for (const fs::path& map : command.maps) {
        const std::size_t all = extension_of(map) == ".png" ? 1 : command.candidates.size();
        for (std::size_t i = 0; i < all; ++i) outputs.push_back(numbered(map, i, all));
    }
    return outputs;
}

/// Puts the maps and pictures where they were asked for, and says so in the figures.
void publish(const EvaluateCommand& command, const proto::Results& results, const fs::path& scratch,
             ordered_json& json) {
    const std::size_t all = results.levels.size();
    const auto place = [&](const std::string& name, const fs::path& map) {
        // The scratch folder may lie on another file system than the map.
        const std::vector<std::byte> bytes = read_file(scratch / name);
        write_text(map, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
        json["maps"].push_back(map.string());
    };
    for (const fs::path& map : command.maps) {
        if (extension_of(map) == ".png") {
            place(results.levels.front().pictures.at(0).href, map);
            continue;
        }
        for (std::size_t i = 0; i < all; ++i)
            for (const proto::OutputFile& file : results.levels[i].files)
                if (extension_of(map) == "." + std::string(to_string(file.format)))
                    place(file.href, numbered(map, i, all));
    }
}

/// The figures of the job without what names files of the service.
ordered_json figures(const EvaluateCommand& command, const proto::Results& results) {
    ordered_json json = ordered_json::parse(proto::evaluation_json(results));
    json.erase("pictures");
    const auto name = [&](ordered_json& candidate, std::size_t i) {
        candidate.erase("files");
        candidate["candidate"]["file"] = command.candidates[i].string();
    };
    if (json.contains("candidates"))
        for (std::size_t i = 0; i < command.candidates.size(); ++i) name(json["candidates"][i], i);
    else
        name(json, 0);
    json["reference"]["file"] = command.reference.string();
    if (results.cost) add_cost(json, *results.cost);
    return json;
}

proto::Results measure(const EvaluateCommand& command, const proto::JobRequest& request,
                       const fs::path& folder, const Session& session, ProgressDisplay& display) {
    const JobExecution execution{command.server, command.common.threads, session.stop,
                                 command.candidates};
    try {
        return execute(request, command.reference, folder, execution, display);
    } catch (const proto::CandidateError& error) {
        if (error.number() > command.candidates.size()) throw;  // as a server may have it
        throw named_after(command.candidates[error.number() - 1], error);
    } catch (const Error& error) {
        throw named_after(command.reference, error);
    }
}

}  // namespace

void run(const EvaluateCommand& command, const Session& session) {
    const auto start = std::chrono::steady_clock::now();
    require_files(inputs_of(command), outputs_of(command));
    proto::JobRequest request{proto::sha256_of_file(command.reference), command.job};
    for (const fs::path& candidate : command.candidates)
        std::get<proto::EvaluateJob>(request.job)
            .candidates.push_back(proto::sha256_of_file(candidate));
    const ScratchFolder scratch(temporary_folder());
    ProgressDisplay display(session.terminal, !command.common.quiet);
    const proto::Results results = measure(command, request, scratch.path(), session, display);
    const auto measured = [](const proto::OutputCloud& cloud) { return cloud.error.has_value(); };
    if (!results.source || results.levels.size() != command.candidates.size() ||
        !std::ranges::all_of(results.levels, measured))
        throw Error(ErrorCode::Internal, "the evaluation did not measure every candidate");
    ordered_json json = figures(command, results);
    publish(command, results, scratch.path(), json);
    display.finish();

    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    const bool figures_alone = command.common.json == "-";
    if (!command.common.quiet && !figures_alone)
        summarise(command, results, took.count(), session.terminal);
    write_json(command.common.json, json);
}

}  // namespace stipple::cli
