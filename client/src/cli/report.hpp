#pragma once

#include "cli/terminal.hpp"
#include "stipple/proto/results.hpp"

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace stipple::cli {

/// The figures of the line that every command ends with.
struct Summary {
    std::uint64_t points_in = 0, points_out = 0;
    std::uint64_t bytes_in = 0, bytes_out = 0;
    double seconds = 0;
};

/// `435,545 → 5,000 points (1.1 %) in 42 ms · 10.4 MB → 60 kB`.
std::string summary_line(const Summary& summary, const TextStyle& style);
/// `removed 12 duplicates, 3 points without finite coordinates, 5 outliers`, `left out
/// face.vertex_indices`; empty when neither.
std::string losses_line(const proto::CloudStatistics& source, const TextStyle& style);

/// Of a Draco file: `coordinates relative to 500000 5000000 100 · rounded by at most 0.0012
/// per axis`; empty when neither.
/// @param step  of the grid on which its points lie; 0: none.
std::string draco_line(const Vec3d& origin, double step, const TextStyle& style);

/// `0.0123 (0.012 %)`: input units, and percent of the diagonal of the reference.
std::string distance_text(double distance, const SurfaceError& error);
/// `(1.5, 2, -3)`: to a hundredth of a distance that was found there, with nine digits at most.
std::string readable_place(const Vec3d& place, double distance);
/// `error: mean 0.0123 ± 0.0011 (0.012 %) · max at least 0.5 (0.4 %) of the diagonal, at 200
/// samples, each within 0.7 of a point`; of a whole cloud `error: none, no points were removed`.
std::string error_line(const proto::ErrorFigures& figures, const TextStyle& style);

/// To standard error; on a terminal that is narrower than the text, more than one line.
void print_line(const std::string& text, const Terminal& terminal);
/// A line for each warning that a measured error came with.
void print_warnings(const proto::ErrorFigures& figures, const std::filesystem::path& candidate,
                    const Terminal& terminal);

/// `largest distance 0.0412 of 0.05 allowed · forward 0.0398, backward 0.0412, 537,380 samples
/// (particles) · 31 tries`; of a whole cloud `kept all 60,000 points: with 30,000 the surface at
/// (0.1, 0.2, 0.3) is off by 0.43, above the bound 0.3`. @param points  of the result.
std::string bound_line(const proto::MeasuredBound& bound, std::uint64_t points,
                       const TextStyle& style);

/// To standard output. @throws Error where it takes nothing.
void write_out(const std::string& text);
/// To the file of `--json`, whole or not at all; `-` is standard output.
void write_json(const std::string& destination, const nlohmann::ordered_json& figures);
/// What came in, for the figures.
nlohmann::ordered_json input_json(const std::filesystem::path& file,
                                  const proto::CloudStatistics& source);
/// `seconds` and what else a job took, for the figures.
void add_cost(nlohmann::ordered_json& figures, const proto::JobCost& cost);
nlohmann::ordered_json bounds_json(const Aabb& box);

}  // namespace stipple::cli
