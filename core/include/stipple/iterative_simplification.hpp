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

/// Where the point of a contracted pair goes.
enum class Placement {
    Optimal,   ///< the minimiser of the summed quadric (§3.2), with safe fallbacks
    EndPoint,  ///< the better of the two: the result is a subset of the input, and levels are
               ///< nested
};

struct IterativeSimplificationOptions {
    std::uint64_t target_size =
        0;           ///< exactly so many points, >= 1; all of them when there are fewer
    unsigned k = 6;  ///< neighbours of a point, to which it may contract (§3.2), 3..32
    Placement placement = Placement::Optimal;
    std::optional<double>
        max_displacement{};   ///< input units, >= 0: no new point is farther from the tangent plane
                              ///< of the input point nearest to it; 0 puts all on the surface
    double color_weight = 0;  ///< what a colour difference of full range costs, as a part of the
                              ///< bounding-box diagonal, >= 0; 0: shape alone; of a cloud
                              ///< that has colours
    std::map<std::string, double>
        attribute_weights{};  ///< the same for other attributes, by name, per range of values
    std::map<std::string, Reduction>
        reductions{};  ///< by attribute name, instead of the attribute's own

    bool operator==(const IterativeSimplificationOptions&) const = default;
};

/// Iterative simplification (§3.2): point pairs are contracted, those of the least quadric error
/// first, until exactly `target_size` points are left.
///
/// A pair of neighbours becomes the point where the sum of their quadrics is least: of the squared
/// distances to the planes of edges of all input points that the pair stands for and, as far as
/// these are rough, to the points themselves, which averages noise. From 8 points for one of the
/// result on, distances to points count the more the more the surface bends there, so that points
/// come to lie closer where the surface through them would lie off the input. Then input points are
/// shared out anew among the new ones, so that each goes with the new point that fits it best; and
/// where the new points are 20 or more, they move until the moving least squares surface through
/// them (§2.2) fits the input: of linear basis, which lies inside of curved parts, and of quadratic
/// basis, which does not. So they lie slightly outside of curved parts; `max_displacement` bounds
/// it. With `Placement::EndPoint` the result is a subset of the input,
/// and that of a smaller target a subset of that of a larger one.
///
/// Weights for colours and other attributes keep points where these change, as well as where the
/// surface bends. Normals, colours and attributes of a new point are those of the input points that
/// it stands for, reduced by their policy; with `EndPoint` they are that point's own, but for
/// attributes named in `reductions`.
///
/// The cloud must hold finite positions, no two alike (`clean`). Points on a line or a plane stay
/// on it; parts that are far from each other are joined last.
///
/// @throws Error(InvalidArgument) for an empty cloud, an option out of range or an attribute that
/// the cloud has not; Error(TooLarge) from 2^31 points on.
/// Expected O(N log N), parallel; about 72 + 4 k bytes a point beyond the cloud, and while few of
/// the points are left, 260 for each of 8 points for one of the result; or up to 4,300 for each of
/// the result, but 30 MB at most, if that is more.
PointCloud iterative_simplification(const PointCloud& cloud,
                                    const IterativeSimplificationOptions& options,
                                    const RunContext& context = {});

/// The clouds of many sizes from one run, finest first: each as `iterative_simplification` gives it
/// for that size. The run costs what the smallest costs.
///
/// @param sizes  descending, each in 1..N; `options.target_size` is not read.
/// @param on_cloud  called for each size, on the calling thread.
/// @throws Error(InvalidArgument) as above, and for a size out of range or order.
void iterative_snapshots(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                         const IterativeSimplificationOptions& options,
                         const std::function<void(PointCloud&&)>& on_cloud,
                         const RunContext& context = {});

}  // namespace stipple
