#pragma once

#include "stipple/surface_error.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stipple::proto {

/// The measured error of a cloud as an approximation of another (§4), as reported in every
/// document. Lengths are in input units; those in `relative` are divided by the diagonal of the
/// reference.
///
///     {"max": 0.9, "mean": 0.02, "rms": 0.04, "relative": {"max": …, "mean": …, "rms": …},
///      "forward": {"max", "mean", "rms", "mean_confidence", "p50", "p95", "p99",
///                  "histogram": [fractions of the area, in bins of equal width from 0 to max],
///                  "samples": 134345, "not_converged": 0.0001, "cover_radius": 1.2,
///                  "relative": {"max", "mean", "rms", "mean_confidence", "p50", "p95", "p99"},
///                  "attributes": [{"name": "color", "max", "mean", "rms"}]},
///      "backward": {…}, "diagonal": 250.1, "samples": 134345,
///      "sampling": "points", "basis": "linear", "range": 0.1, "warnings": ["…"]}
///
/// `forward` is from the reference to the candidate, `backward` the other way; `max` is of both,
/// `mean`, `rms` and `samples` are those of `forward`. `cover_radius` is absent from errors of a
/// bound. The histogram and the attributes are absent unless requested, `range` without a map,
/// `warnings` if there are none.
struct ErrorFigures {
    SurfaceError error;  ///< without the samples
    ErrorSampling sampling = ErrorSampling::Points;
    ErrorSurface surface = ErrorSurface::Linear;
    std::optional<double> range{};        ///< distance of the last colour of its map
    std::vector<std::string> warnings{};  ///< why the figures may be unreliable
};

std::string to_json(const ErrorFigures& figures);

/// The figures of a measurement with `options`, with warnings: fewer points than the surface needs,
/// a distance larger than one of the diagonals, many samples that did not converge.
ErrorFigures error_figures(const SurfaceError& error, const SurfaceErrorOptions& options,
                           std::uint64_t reference_points, std::uint64_t candidate_points);

/// The distance as a fraction of the diagonal; 0 if all points of the reference coincide.
double relative(double distance, const SurfaceError& error) noexcept;

/// The views of pictures, with the axis `up` up: the front is seen along -z (y or x up) or along +y
/// (z up).
inline constexpr std::array<std::string_view, 6> kViews = {"front", "right", "back",
                                                           "left",  "top",   "bottom"};

/// How clouds are compared, and how the result is shown.
struct EvaluationOptions {
    SurfaceErrorOptions measure;
    std::optional<double> range;  ///< distance of the last colour, > 0; by default a round number
                                  ///< above the distance of 99 % of the area of every candidate
    bool pictures = false;        ///< a PNG sheet of all candidates from all views
    std::vector<std::string> views = {"front", "right", "back", "left"};  ///< of `kViews`
    char up = 'y';                                                        ///< x, y or z
    std::vector<std::string>
        labels;  ///< names of the candidates in pictures; empty, or one for each
};

/// @throws Error(InvalidArgument) with the option, its value and the limit.
void validate(const EvaluationOptions& options);

std::string_view to_string(ErrorSampling sampling) noexcept;
std::string_view to_string(ErrorSurface surface) noexcept;
/// @throws Error(InvalidArgument) naming the available names.
ErrorSampling error_sampling_from_name(std::string_view name);
ErrorSurface error_surface_from_name(std::string_view name);

}  // namespace stipple::proto
