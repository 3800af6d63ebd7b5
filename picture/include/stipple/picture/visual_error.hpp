#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/splat_renderer.hpp"
#include "stipple/surface_error.hpp"

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace stipple {

// The visual estimate of §4 (Figures 10 and 13): the samples Q of a reference, coloured by their
// distance to a candidate.

/// The smallest of 1, 1.5, 2, 2.5, 3, 4, 5, 6 and 8 times a power of ten that is at least `value`;
/// 1 for 0.
double round_up(double value) noexcept;

/// Samples and their distances (`SurfaceErrorOptions::keep_samples`) as a cloud: colours in viridis
/// from 0 to `range`, and the attribute `distance` (float, input units). `origin` is the
/// reference's. O(samples).
PointCloud colored_by_distance(const DirectedError& error, const Vec3d& origin, double range);

/// A candidate in a picture.
struct VisualError {
    std::string label;               ///< UTF-8
    std::vector<std::string> notes;  ///< lines under it
    const PointCloud* samples;       ///< of `colored_by_distance`
};

struct VisualErrorOptions {
    double range = 1;  ///< of the colours, input units
    std::string legend;
    std::vector<std::string> views = {"front"};  ///< front, right, back, left, top, bottom: each
                                                 ///< slightly from above and from the right
    char up = 'y';  ///< the axis that points up; the front is at +z (y or x up) or at -y (z up)
    unsigned height = 420;  ///< of each picture, pixels
};

struct Picture {
    unsigned width = 0, height = 0;
    std::vector<std::byte> png;
};

/// Draws candidates as small multiples: the same camera for each view, the same colours and one
/// legend for all. Several candidates have a column each, and views a row each; for a single
/// candidate, views are side by side.
///
/// @throws Error(InvalidArgument) for an unknown view, or a sheet that is too large.
///
/// About 0.2 s per picture, parallel.
Picture draw_visual_error(std::span<const VisualError> candidates,
                          const VisualErrorOptions& options, const RunContext& context = {});

}  // namespace stipple
