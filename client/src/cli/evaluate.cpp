#include "cli/commands.hpp"
#include "cli/files.hpp"
#include "cli/job_execution.hpp"
#include "cli/report.hpp"
#include "cli/units.hpp"
#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <iostream>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

/// `text` in so many columns, to the left or to the right of them.
std::string left(const std::string& text, std::size_t columns) {
    const unsigned width = display_width(text);
    return width < columns ? text + std::string(columns - width, ' ') : text;
}
std::string right(const std::string& text, std::size_t columns) {
    const unsigned width = display_width(text);
    return width < columns ? std::string(columns - width, ' ') + text : text;
}

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

void print_row(const TextStyle& style, const std::string& name, const std::string& forward,
               const std::string& backward) {
    std::cerr << style.dim(left(name, 10)) << right(forward, 24) << right(backward, 24) << '\n';
}

/// All that is known of one candidate, in both directions.
void print(const proto::OutputCloud& cloud, const TextStyle& style) {
    const SurfaceError& error = cloud.error->error;
    const DirectedError &forward = error.forward, &backward = error.backward;
    print_row(style, "", "reference to candidate", "candidate to reference");
    const auto row = [&](const char* name, double DirectedError::*field) {
        print_row(style, name, distance_text(forward.*field, error),
                  distance_text(backward.*field, error));
    };
    row("mean", &DirectedError::mean);
    row("rms", &DirectedError::rms);
    row("p50", &DirectedError::p50);
    row("p95", &DirectedError::p95);
    row("p99", &DirectedError::p99);
    row("max", &DirectedError::max);
    print_row(style, "0 .. max", blocks(forward.histogram, 20, style.unicode),
              blocks(backward.histogram, 20, style.unicode));
    print_row(style, "samples", with_separators(forward.samples),
              with_separators(backward.samples));
    for (std::size_t i = 0; i < forward.attributes.size() && i < backward.attributes.size(); ++i) {
        const auto mean = [](const AttributeError& a) {
            return three_digits(a.mean) + ", at most " + three_digits(a.max);
        };
        print_row(style, forward.attributes[i].name, mean(forward.attributes[i]),
                  mean(backward.attributes[i]));
    }
    std::cerr << style.dim("input units, and percent of the diagonal, " +
                           three_digits(error.diagonal))
              << '\n';
}

/// A row for each candidate; what is least of a column is set in bold.
void print_table(const EvaluateCommand& command, const proto::Results& results,
                 const TextStyle& style) {
    std::size_t names = 9;
    for (const fs::path& file : command.candidates)
        names = std::max<std::size_t>(names, display_width(file.filename().string()));
    std::cerr << style.dim(left("candidate", names) + right("points", 12) + right("mean", 22) +
                           right("rms", 22) + right("max", 22))
              << '\n';
    const auto least = [&](auto&& of) {
        double value = of(results.levels.front().error->error);
        for (const proto::OutputCloud& cloud : results.levels)
            value = std::min(value, of(cloud.error->error));
        return value;
    };
    const auto cell = [&](const SurfaceError& error, auto&& of) {
        const std::string text = right(distance_text(of(error), error), 22);
        return of(error) <= least(of) ? style.strong(text) : text;
    };
    for (std::size_t i = 0; i < results.levels.size(); ++i) {
        const SurfaceError& error = results.levels[i].error->error;
        std::cerr << left(command.candidates[i].filename().string(), names)
                  << right(with_separators(results.levels[i].points), 12)
                  << cell(error, [](const SurfaceError& e) { return e.mean(); })
                  << cell(error, [](const SurfaceError& e) { return e.rms(); })
                  << cell(error, [](const SurfaceError& e) { return e.max(); }) << '\n';
    }
    std::cerr << style.dim(
                     "mean and rms from the reference to the candidate, max of both ways; "
                     "input units, and percent of the diagonal, " +
                     three_digits(results.levels.front().error->error.diagonal))
              << '\n';
}

void summarise(const EvaluateCommand& command, const proto::Results& results, double seconds,
               const Terminal& terminal) {
    const TextStyle& style = terminal.style();
    const bool one = results.levels.size() == 1;
    std::cerr << style.strong(counted(results.source->points, "point") + " against " +
                              (one ? counted(results.levels.front().points, "point")
                                   : counted(results.levels.size(), "candidate")))
              << " in " << readable_seconds(seconds) << '\n';
    if (one)
        print(results.levels.front(), style);
    else
        print_table(command, results, style);
    for (std::size_t i = 0; i < results.levels.size(); ++i)
        for (const std::string& warning : results.levels[i].error->warnings)
            std::cerr << style.bad("warning:") << ' ' << command.candidates[i].filename().string()
                      << ": " << warning << '\n';
}

/// Where the map of a candidate goes: `errors.ply`, or `errors-2.ply` when there are several.
fs::path numbered(const fs::path& file, std::size_t candidate, std::size_t all) {
    if (all == 1) return file;
    return file.parent_path() /
           (file.stem().string() + "-" + std::to_string(candidate + 1) + file.extension().string());
}

/// Puts the maps and pictures where they were asked for, and says so in the figures.
void publish(const EvaluateCommand& command, const proto::Results& results, const fs::path& scratch,
             ordered_json& json) {
    const std::size_t all = results.levels.size();
    const auto place = [&](const std::string& name, const fs::path& map) {
        // Another scratch folder may lie on another file system than the map.
        const ScratchFolder beside(folder_of(map));
        fs::copy_file(scratch / name, beside.path() / name);
        move_into_place(beside.path() / name, map);
        json["maps"].push_back(map.string());
    };
    for (const fs::path& map : command.maps) {
        if (map.extension() == ".png") {
            place(results.levels.front().pictures.at(0).href, map);
            continue;
        }
        for (std::size_t i = 0; i < all; ++i)
            for (const proto::OutputFile& file : results.levels[i].files)
                if (map.extension() == "." + std::string(to_string(file.format)))
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

/// The error of the job with the file in front that it is about.
Error naming_file(const EvaluateCommand& command, const Error& error) {
    const std::string message = error.what();
    for (std::size_t i = 0; i < command.candidates.size(); ++i) {
        const std::string which = "candidate " + std::to_string(i + 1) + ": ";
        if (message.starts_with(which))
            return named_after(command.candidates[i],
                               Error(error.code(), message.substr(which.size())));
    }
    return named_after(command.reference, error);
}

proto::Results measure(const EvaluateCommand& command, const proto::JobRequest& request,
                       const fs::path& folder, const Session& session, ProgressDisplay& display) {
    const JobExecution execution{command.server, command.common.threads, session.stop,
                                 command.candidates};
    try {
        return execute(request, command.reference, folder, execution, display);
    } catch (const Error& error) {
        throw naming_file(command, error);
    }
}

}  // namespace

void run(const EvaluateCommand& command, const Session& session) {
    const auto start = std::chrono::steady_clock::now();
    require_input(command.reference);
    proto::JobRequest request{proto::sha256_of_file(command.reference), command.job};
    for (const fs::path& candidate : command.candidates) {
        require_input(candidate);
        std::get<proto::EvaluateJob>(request.job)
            .candidates.push_back(proto::sha256_of_file(candidate));
    }
    require_place_of(command.common.json);
    for (const fs::path& map : command.maps) require_place_of(map);
    const ScratchFolder scratch(fs::temp_directory_path());
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
