#include "cli/report.hpp"

#include "cli/files.hpp"
#include "cli/text.hpp"
#include "cli/units.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <iomanip>
#include <iostream>
#include <sstream>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

}  // namespace

std::string summary_line(const Summary& summary, const TextStyle& style) {
    const std::string arrow = " " + std::string(style.arrow()) + " ";
    return style.strong(with_separators(summary.points_in) + arrow +
                        counted(summary.points_out, "point")) +
           " (" + readable_share(summary.points_out, summary.points_in) + ") in " +
           readable_seconds(summary.seconds) + " " + std::string(style.dot()) + " " +
           readable_bytes(summary.bytes_in) + arrow + readable_bytes(summary.bytes_out);
}

std::string losses_line(const proto::CloudStatistics& source, const TextStyle& style) {
    std::vector<std::string> removed;
    if (source.duplicates > 0) removed.push_back(counted(source.duplicates, "duplicate"));
    if (source.non_finite > 0)
        removed.push_back(counted(source.non_finite, "point") + " without finite coordinates");
    if (source.outliers) removed.push_back(counted(*source.outliers, "outlier"));

    std::vector<std::string> losses;
    if (!removed.empty()) losses.push_back("removed " + joined(removed, ", "));
    if (!source.skipped.empty())
        losses.push_back("left out " + printable(joined(source.skipped, ", ")));
    return joined(losses, " " + std::string(style.dot()) + " ");
}

std::string draco_line(const Vec3d& origin, double step, const TextStyle& style) {
    std::vector<std::string> parts;
    if (!origin.isZero(0)) {
        std::ostringstream text;
        text << "coordinates relative to" << std::setprecision(15);
        for (const double x : origin) text << ' ' << x;
        parts.push_back(text.str());
    }
    if (step > 0) parts.push_back("rounded by at most " + three_digits(0.5 * step) + " per axis");
    return joined(parts, " " + std::string(style.dot()) + " ");
}

std::string readable_place(const Vec3d& place, double distance) {
    const double unit = distance > 0 ? std::pow(10, std::floor(std::log10(distance / 100))) : 0;
    std::ostringstream text;
    text << std::setprecision(9);
    for (const double x : place)
        text << (text.tellp() > 0 ? ", " : "(")
             << (unit > 0 ? unit * std::round(x / unit) + 0.0 : x);  // no minus before a zero
    text << ")";
    return text.str();
}

namespace {

/// Why no point of a cloud could go.
std::string whole_line(const proto::MeasuredBound& bound, std::uint64_t points) {
    const std::string kept = "kept all " + counted(points, "point") + ": ",
                      allowed = three_digits(bound.max_error);
    if (!bound.too_far) return kept + "no smaller cloud was found within " + allowed;
    const auto& [tried, place, distance] = *bound.too_far;
    const std::string off = three_digits(distance) + ", above the bound " + allowed;
    if (tried == points)
        return kept + "the one at " + readable_place(place, distance) +
               " is off their own surface by " + off + ": the bound is below the noise";
    return kept + "with " + with_separators(tried) + " the surface at " +
           readable_place(place, distance) + " is off by " + off +
           "; `stipple curve` shows the errors of other counts";
}

}  // namespace

std::string bound_line(const proto::MeasuredBound& bound, std::uint64_t points,
                       const TextStyle& style) {
    const std::string dot = " " + std::string(style.dot()) + " ";
    const std::string ended =
        bound.ended_early
            ? dot + "the search ended early, at its limit of work: fewer points may also hold"
            : "";
    if (bound.whole) return whole_line(bound, points) + ended;
    return "largest distance " + three_digits(std::max(bound.forward, bound.backward)) + " of " +
           three_digits(bound.max_error) + " allowed" + dot + "forward " +
           three_digits(bound.forward) + ", backward " + three_digits(bound.backward) + ", " +
           counted(bound.samples, "sample") + " (" + std::string(proto::to_string(bound.sampling)) +
           ")" + dot + counted(bound.tries, "try", "tries") +
           (bound.points_off_surface == 0
                ? ""
                : dot + "not counted: " + counted(bound.points_off_surface, "point") +
                      " of the input, farther than that from its surface") +
           ended;
}

void write_out(const std::string& text) {
    std::cout << text << std::flush;
    if (!std::cout && errno == EPIPE) {  // as when nobody had asked for the signal to be ignored
        std::signal(SIGPIPE, SIG_DFL);
        std::raise(SIGPIPE);
    }
    if (!std::cout) throw Error(ErrorCode::Internal, "standard output: cannot be written");
}

void write_json(const std::string& destination, const ordered_json& figures) {
    if (destination.empty()) return;
    const std::string text =
        figures.dump(2, ' ', false, ordered_json::error_handler_t::replace) + "\n";
    return destination == "-" ? write_out(text) : write_text(destination, text);
}

ordered_json input_json(const fs::path& file, const proto::CloudStatistics& source) {
    ordered_json input = ordered_json::parse(proto::to_json(source));
    input["file"] = file.string();
    input["bytes"] = fs::file_size(file);
    return input;
}

void add_cost(ordered_json& figures, const proto::JobCost& cost) {
    figures["threads"] = cost.threads;
    figures["seconds"] = {{"decode", cost.decode_seconds}, {"simplify", cost.simplify_seconds},
                          {"splats", cost.splats_seconds}, {"error", cost.error_seconds},
                          {"encode", cost.encode_seconds}, {"total", cost.total_seconds}};
    figures["peak_memory_bytes"] = cost.peak_memory_bytes;
}

std::string distance_text(double distance, const SurfaceError& error) {
    return three_digits(distance) + " (" + three_digits(100 * proto::relative(distance, error)) +
           " %)";
}

std::string error_line(const proto::ErrorFigures& figures, const TextStyle& style) {
    const SurfaceError& error = figures.error;
    if (error.forward.samples == 0) return "error: none, no points were removed";
    const std::string dot = " " + std::string(style.dot()) + " ";
    const DirectedError& forward = error.forward;
    // Where few of the samples met an error at all no interval holds.
    const bool is_rough = 2 * forward.mean_confidence > error.mean();
    std::string line =
        std::string("error: mean ") + (is_rough ? "about " : "") + three_digits(error.mean());
    if (forward.mean_confidence > 0 && !is_rough)
        line += " " + std::string(style.plus_minus()) + " " + two_digits(forward.mean_confidence);
    line += " (" + three_digits(100 * proto::relative(error.mean(), error)) + " %)" + dot +
            "max at least " + distance_text(error.max(), error) + " of the diagonal, at " +
            counted(forward.samples, "sample");
    if (forward.cover_radius)
        line += ", each within " + three_digits(*forward.cover_radius) + " of a point";
    return line;
}

void print_line(const std::string& text, const Terminal& terminal) {
    // In one write: others write to the same terminal, and would come between.
    std::cerr << (terminal.interactive() ? wrapped(text, terminal.columns()) : text) + '\n';
}

void print_warnings(const proto::ErrorFigures& figures, const fs::path& candidate,
                    const Terminal& terminal) {
    for (const std::string& warning : figures.warnings)
        print_line(terminal.style().bad("warning:") + " " +
                       printable(candidate.filename().string() + ": " + warning),
                   terminal);
}

ordered_json bounds_json(const Aabb& box) {
    const auto corner = [](const Vec3d& v) { return ordered_json::array({v.x(), v.y(), v.z()}); };
    return {{"min", corner(box.min)}, {"max", corner(box.max)}};
}

}  // namespace stipple::cli
