#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

struct FeatureLineOptions {
    double variation = 0.03;  ///< smallest sigma_n (Eq. 5) of a neighbourhood on a feature, in (0,
                              ///< 1/3): a right angle has 0.085, one of 135 degrees 0.02
    double high = 0.7;        ///< weight that a line must reach somewhere, in [low, 1]
    double low = 0.4;         ///< weight that a line must keep everywhere, in (0, high]
    unsigned min_links =
        4;  ///< branches with fewer links are pruned, loops are not closed; 2..1000
};

/// Creases, edges and corners of a surface.
struct FeatureLines {
    std::vector<float> weights;  ///< N: the fraction of scales, from the largest down, at which the
                                 ///< point is on a feature
    std::vector<Index> points;  ///< of all lines, one after the other, in the order they are joined
    std::vector<std::uint64_t>
        offsets;  ///< lines + 1; line l is `points[offsets[l]]` up to, excluding, `points[offsets[l
                  ///< + 1]]`; a closed line ends at its first point

    std::size_t size() const noexcept { return offsets.empty() ? 0 : offsets.size() - 1; }
    std::span<const Index> line(std::size_t l) const noexcept {
        return {points.data() + offsets[l], points.data() + offsets[l + 1]};
    }
};

/// Feature lines by surface variation at several scales (the paper's future work; Pauly, Keiser and
/// Gross 2003): noise is a feature only at small scales, an edge at all of them. Points with weight
/// are thinned to the ridge of the variation, joined by a minimum spanning graph that closes long
/// loops, pruned, and cut into lines at its forks. Lines are ordered by the number of their first
/// point.
///
/// Positions must be finite (`clean`). Neighbourhoods have 8 to 64 points, so features closer than
/// about four spacings merge into one.
/// @throws Error(InvalidArgument) for an option out of range.
///
/// Expected O(N), parallel, and more for a large `min_links`, within which loops are looked for;
/// about 50 bytes per point while it runs. The same result for any number of threads.
FeatureLines find_feature_lines(std::span<const Vec3f> points,
                                const FeatureLineOptions& options = {},
                                const RunContext& context = {});

}  // namespace stipple
