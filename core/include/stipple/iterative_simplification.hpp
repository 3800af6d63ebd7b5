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
    unsigned k = 8;  ///< neighbours of a point, to which it may contract, 3..32
    Placement placement = Placement::Optimal;
    std::optional<double>
        max_displacement{};   ///< input units: no new point is farther from the input surface
    double color_weight = 0;  ///< what a colour difference of full range costs, as a part of the
                              ///< bounding-box diagonal; 0: shape alone
    std::map<std::string, double>
        attribute_weights{};  ///< the same for scalars, by name, per range of values
    std::map<std::string, Reduction>
        reductions{};  ///< by attribute name, instead of the attribute's own
};

/// Iterative simplification (§3.2): point pairs are contracted, those of the least quadric error
/// first.
PointCloud iterative_simplification(const PointCloud& cloud,
                                    const IterativeSimplificationOptions& options,
                                    const RunContext& context = {});

/// The clouds of many sizes from one run, finest first.
///
/// @param sizes  descending, each in 1..N; `options.target_size` is not read.
/// @param on_cloud  called for each size, on the calling thread.
void iterative_snapshots(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                         const IterativeSimplificationOptions& options,
                         const std::function<void(PointCloud&&)>& on_cloud,
                         const RunContext& context = {});

}  // namespace stipple
