#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/simplify.hpp"

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace stipple {

struct LodPyramidOptions {
    std::vector<std::uint64_t>
        sizes{};         ///< points of each level, strictly ascending; empty: by ratio
    double ratio = 4.0;  ///< in (1, 64]: each level has this many times the points of the one above
    std::uint64_t base_points = 10'000;  ///< most points of the coarsest level by ratio
    std::function<bool(const PointCloud&)>
        base_fits{};  ///< if set, levels by ratio begin with the largest level it accepts, of those
                      ///< tried: `base_points` or the whole cloud, then each 10 % smaller
    SimplifyOptions simplification{
        .method = Method::Hierarchical};  ///< the method and its options, without a target.
                                          ///< `multiphase` and `iterative`: less error, more time
    bool nested = false;  ///< each level begins with the points of the one above, unchanged:
                          ///< prefixes of one order, contraction to an end point in reverse. Only
                          ///< `iterative`, whose options and `reductions` are ignored
    bool spacing = true;  ///< measure each level's spacing; unnecessary if its tiles report it
    std::span<const Index> order{};  ///< of all points along a curve, if known (`LodTiler::order`):
                                     ///< a tree of millions then grows faster, over points that are
                                     ///< adjacent in memory, with 12 more bytes per point. Only for
                                     ///< `incremental`, and for `hierarchical` without `base_fits`
};

/// One level of a pyramid, 0 the coarsest.
struct LodLevel {
    unsigned level = 0;
    PointCloud cloud;
    double spacing = 0;  ///< mean distance to the nearest other point, input units; 0 for a single
                         ///< point, and if not measured
    std::vector<Index> order{};  ///< of its points along the curve of `LodPyramidOptions::order`;
                                 ///< empty without one, and for the whole cloud
};

/// @throws Error(InvalidArgument) for an option out of range.
void validate(const LodPyramidOptions& options);

/// The sizes that `options`, without `base_fits`, give for a cloud of `points`: the finest by ratio
/// is the whole cloud; a listed size above the count becomes the count. Ascending, distinct, never
/// empty.
std::vector<std::uint64_t> lod_sizes(std::uint64_t points, const LodPyramidOptions& options);

/// Levels of detail of a cleaned cloud, from one run of a method: cuts of the tree of
/// `hierarchical_clustering`, contractions of such cuts by `multiphase`, or levels derived from
/// levels by `iterative` and `incremental`, each from one with at least three times its points if
/// there is one, yet still representing the cloud's points. With the other methods each level is
/// what `simplify` makes of the cloud; particles move on one surface and are spread separately for
/// each level, since parts without particles at first would stay bare if particles were split. The
/// level of all points is the cloud itself; for nested levels, in their order. Colours of other
/// levels are means of what their points stand for, also with methods that keep points, where they
/// would speckle (but for `random`, nested levels, and a policy `Nearest` of `color`).
///
/// Levels have more points where the surface bends, yet no holes where it is flat: on an evenly
/// sampled surface no point is farther from a level than three times its spacing, except with
/// `random`. What the cloud itself leaves bare, such as between the last returns of a LiDAR scan,
/// no level covers.
///
/// @param on_level  called for each level, coarsest first, on the calling thread: for cuts and
/// derived levels, which are kept until then, once the run is over; for the other methods, before
/// the next level begins.
/// @throws Error(InvalidArgument) for options out of range, a target, a cloud without points, an
/// order of another number of points, or a single point that `base_fits` does not accept.
///
/// All cuts of the dragon take 1.1 to 1.2 times as long as its finest alone
/// (`pyramid/dragon/ratio-4` of stipple-bench), without their spacing. 16 bytes per point besides
/// the tree; with an order, 4 for each point of the levels.
void build_lod_pyramid(const PointCloud& cloud, const LodPyramidOptions& options,
                       const std::function<void(LodLevel&&)>& on_level,
                       const RunContext& context = {});
/// The same without a copy: the level of all points is the cloud itself, which is empty when
/// `on_level` gets it; with nested levels it remains.
void build_lod_pyramid(PointCloud&& cloud, const LodPyramidOptions& options,
                       const std::function<void(LodLevel&&)>& on_level,
                       const RunContext& context = {});

}  // namespace stipple
