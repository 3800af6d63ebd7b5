#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>

namespace stipple {

/// Where a contracted pair moves.
enum class Placement {
    Optimal,   ///< the minimiser of the summed quadric (§3.2), with safe fallbacks
    EndPoint,  ///< the better of the two points: the result is a subset of the input, and levels
               ///< are nested
};

struct IterativeSimplificationOptions {
    std::uint64_t target_size = 0;  ///< exactly this many points, >= 1; all if there are fewer
    unsigned k = 6;  ///< number of neighbours with which a point may contract (§3.2), 3..32
    Placement placement = Placement::Optimal;
    std::optional<double>
        max_displacement{};  ///< input units, >= 0: no new point is farther than this from the
                             ///< tangent plane of the input point nearest to it, or, where the
                             ///< neighbours of that lie about no plane, as at edges and in noise,
                             ///< from that point itself; 0 puts all on the surface
    double color_weight =
        0;  ///< cost of a colour difference of full range, as a fraction of the bounding-box
            ///< diagonal, >= 0; 0: shape alone; above 0 only for clouds with colours
    std::map<std::string, double> attribute_weights{};  ///< the same for other attributes, by name;
                                                        ///< relative to the attribute's range
    std::map<std::string, Reduction>
        reductions{};  ///< by attribute name, overriding the attribute's own

    bool operator==(const IterativeSimplificationOptions&) const = default;
};

/// Iterative simplification (§3.2): point pairs are contracted, those of least quadric error first,
/// until exactly `target_size` points are left.
///
/// A pair of neighbours becomes the point that minimises the sum of their quadrics: squared
/// distances to the planes of edges of all input points that the pair represents and, as far as
/// these are rough, to the points themselves, which averages noise. Once 8 points are left for each
/// one of the result, distances to points count more where the surface bends more, so that points
/// end up closer where the surface through them would deviate from the input. Then the input points
/// are reassigned to the new points that fit them best. If there are 20 new points or more, they
/// move until the moving least squares surface through them (§2.2) fits the input: with a linear
/// basis, which lies inside curved parts, and with a quadratic basis, which does not. So they lie
/// slightly outside of curved parts; `max_displacement` bounds this. Where new points lie in two
/// layers, like the sides of a wall, they go amid the input points that they represent instead.
/// With `Placement::EndPoint` the result is a subset of the input, and that of a smaller target a
/// subset of that of a larger one.
///
/// Weights for colours and other attributes keep points where these change, as well as where the
/// surface bends. Normals, colours and attributes of a new point are reduced from those of the
/// input points it represents; with `EndPoint` they are copied from that point, except for
/// attributes named in `reductions`.
///
/// The cloud must hold finite, distinct positions (`clean`). Points on a line or a plane stay on
/// it; parts far from each other are joined last.
///
/// @throws Error(InvalidArgument) for an empty cloud, an option out of range or an attribute that
/// the cloud does not have; Error(TooLarge) for 2^31 points or more.
///
/// Expected O(N log N), parallel. Beyond the cloud about 72 + 4 k bytes per point and, when few
/// points are left, 260 for each of 8 points per point of the result; or up to 4,300 per point of
/// the result, but at most 30 MB, if that is more.
PointCloud iterative_simplification(const PointCloud& cloud,
                                    const IterativeSimplificationOptions& options,
                                    const RunContext& context = {});

/// The clouds of many sizes from one run, finest first: each as `iterative_simplification` returns
/// it for that size. The run costs as much as the smallest.
///
/// @param sizes  descending, each in 1..N; `options.target_size` is ignored.
/// @param on_cloud  called for each size, on the calling thread.
/// @throws Error(InvalidArgument) as above, and for a size out of range or order.
void iterative_snapshots(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                         const IterativeSimplificationOptions& options,
                         const std::function<void(PointCloud&&)>& on_cloud,
                         const RunContext& context = {});

}  // namespace stipple
