#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/simplify.hpp"
#include "stipple/surface_error.hpp"

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

namespace stipple {

/// The methods of which every count is a result that measures like the next: those that can be
/// asked for an error instead of a count.
inline constexpr std::array kErrorBoundedMethods = {Method::Multiphase, Method::Hierarchical,
                                                    Method::Iterative, Method::Particles};
/// @throws Error(InvalidArgument) for another method, naming those that can.
void require_error_bounded(Method method);

/// A cloud that was too far from the surface of the input, in the coordinates of that.
struct TooFar {
    std::uint64_t points = 0;  ///< that it had
    Vec3d place{0, 0, 0};      ///< where it was farthest: on the surface of either
    double distance = 0;
};

/// A cloud whose measured error is within a bound.
struct ErrorBoundedCloud {
    PointCloud cloud{};
    double bound = 0;      ///< what was asked for, in input units
    SurfaceError error{};  ///< as measured last, with the samples that found most
    ErrorSampling sampling = ErrorSampling::Surface;  ///< of that measurement
    std::uint64_t points_off_surface = 0;  ///< of the input, farther from its own surface than the
                                           ///< bound: not counted
    unsigned tries = 0;                    ///< clouds that were measured
    bool whole = false;  ///< it is the input itself: no smaller cloud was found within the bound
    std::optional<TooFar> too_far{};  ///< of a whole one: of the clouds tried that had distances
                                      ///< above the bound, that with most points
};

/// Few points within an error: the second problem of the paper (§1). The larger of both directions'
/// measured distances (Δ_max of Eq. 9, `measure_error` with the linear basis) is at most
/// `options.max_error`, in input units, or `options.max_error_rel` times the diagonal of the box.
///
/// One run of the method gives snapshots of many counts, up to half of the points; of large clouds
/// up to 100,000, unless more are needed. How fine they must be differs from place to place: so
/// places are taken from the coarsest snapshot that is within 95 % of the bound there, with their
/// neighbours, and from no snapshots far apart beside each other; what is still too far is made
/// finer, until nothing is. Such a cloud mostly has far fewer points than the smallest snapshot
/// that is within the bound everywhere; where it has more, that snapshot is taken. So particles are
/// of several spacings as well.
///
/// The search looks at all points of the cloud, at places around them and around the points of the
/// candidate, from try to try only where points have come or gone; once none of these is too far,
/// at more places where distances are large or the candidate's surface is uneven. Then the result
/// is measured as anyone would: at random places of each surface, twice as many as the cloud has
/// points, at least 200,000, but no more than 300,000 or a hundred for each point of the result;
/// and at more of them around large distances. All must be within 97 % of the bound, else the
/// search goes on from what was found, in larger steps after 16 rounds. A maximum over samples is
/// below that over all of a surface: another measurement may find a little more, which the last 3 %
/// are for.
///
/// What is found so is read as `measure_error` does: places in knots of points without a normal are
/// none of the surface, and a distance is no larger than that of a place beside and the way there.
/// One who measures without such care finds more. Therefore the search goes on until neither holds
/// any more, also at other 800,000 places or as many as before, unless that takes more than a
/// quarter of the points again.
///
/// Where no smaller cloud is within the bound, or of 50,000 points and more none of up to half of
/// them, the input itself comes back, with an error of 0. A point of the input that is farther than
/// the bound from the input's own surface is no place of it, and not looked at; where more than one
/// in a hundred are, the bound is below the noise, and the input comes back as well; `too_far` then
/// has all its points, and that which is farthest from its own surface.
///
/// @throws Error(InvalidArgument) for a bound that is not finite and positive, a method that is not
/// one of `kErrorBoundedMethods`, other options out of range, or a cloud without points.
/// Time: mostly one run of the method, seldom two (of particles one for each of up to 50 counts), a
/// measurement, and a tenth of one for each of some tens of other `tries`. Memory: that of the
/// method, three clouds, and 60 bytes for each place that is looked at.
ErrorBoundedCloud simplify_within_error(const PointCloud& cloud, const SimplifyOptions& options,
                                        const RunContext& context = {});

/// Of which method the curve is, and at which counts.
struct ErrorCurveOptions {
    SimplifyOptions simplification{};     ///< method and its options; without a target
    std::vector<std::uint64_t> points{};  ///< counts, ascending, each at least 1; those that the
                                          ///< cloud has not are left out. Empty: chosen
    unsigned count = 24;                  ///< how many are chosen (`curve_counts`), 2..64
};
/// Checks what can be checked without a cloud. @throws Error(InvalidArgument).
void validate(const ErrorCurveOptions& options);
/// The counts for a cloud, descending. @throws Error(InvalidArgument) where it has none of them.
std::vector<std::uint64_t> curve_counts(std::uint64_t points, const ErrorCurveOptions& options);

/// A point of the count-error curve.
struct CurvePoint {
    std::uint64_t points = 0;
    SurfaceError error;
};

/// `count` counts for a curve, evenly spaced on a logarithmic axis, descending: from half of the
/// `points`, a million at most, to a thousandth of them, 20 at least. Fewer where there are not so
/// many.
std::vector<std::uint64_t> curve_counts(std::uint64_t points, unsigned count = 24);

/// How the error grows as points go: snapshots of one run (particles: of a run for each), each
/// measured as `measure_error` does with `measure`.
///
/// @param counts  descending, each in 1..N - 1; see `curve_counts`.
/// @param on_point  called for each count, in their order, on the calling thread.
/// @throws Error(InvalidArgument) for a method that is not one of `kErrorBoundedMethods`, counts
/// out of range or order, or a cloud without points. Time: one run of the method and a measurement
/// for each count.
void error_curve(const PointCloud& cloud, const SimplifyOptions& options,
                 std::span<const std::uint64_t> counts,
                 const std::function<void(const CurvePoint&)>& on_point,
                 const SurfaceErrorOptions& measure = {}, const RunContext& context = {});

}  // namespace stipple
