#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/simplify.hpp"
#include "stipple/surface_error.hpp"

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

namespace stipple {

/// The methods whose results measure alike at every count: those that accept an error instead of a
/// count.
inline constexpr std::array kErrorBoundedMethods = {Method::Multiphase, Method::Hierarchical,
                                                    Method::Iterative, Method::Particles};
/// @throws Error(InvalidArgument) for another method, naming those allowed.
void require_error_bounded(Method method);

/// A cloud that was too far from the surface of the input, in the input's coordinates.
struct TooFar {
    std::uint64_t points = 0;  ///< of the cloud
    Vec3d place{0, 0, 0};      ///< where it was farthest off: on either surface
    double distance = 0;
};

/// A cloud whose measured error is within a bound.
struct ErrorBoundedCloud {
    PointCloud cloud{};
    double bound = 0;      ///< the requested bound, in input units
    SurfaceError error{};  ///< as measured last, with the samples that found the largest error
    ErrorSampling sampling = ErrorSampling::Surface;  ///< of that measurement
    std::uint64_t points_off_surface =
        0;               ///< of the input, off its own surface by 95 % of the bound: not counted
    unsigned tries = 0;  ///< number of clouds measured
    bool whole =
        false;  ///< the result is the input itself: no smaller cloud was found within the bound
    bool ended_early = false;  ///< after as many places as a search looks at: the result holds, but
                               ///< fewer points may
    std::optional<TooFar> too_far{};  ///< if `whole`: among the clouds tried that exceeded the
                                      ///< bound, the one with the most points
};

/// Few points within an error: the second problem of the paper (§1). The larger of both directions'
/// measured distances (Δ_max of Eq. 9, `measure_error` with the linear basis) is at most
/// `options.max_error`, in input units, or `options.max_error_rel` times the diagonal of the box.
///
/// One run of the method yields snapshots of many counts, up to half of the points; for large
/// clouds up to 100,000, unless more are needed. The fineness needed differs from place to place:
/// so each place is taken from the coarsest snapshot that is within 95 % of the bound there, with
/// its neighbours, and snapshots far apart are never adjacent; places still too far are refined,
/// until none is. Such a cloud mostly has far fewer points than the smallest snapshot that is
/// within the bound everywhere; if it has more, that snapshot is used. Particles therefore have
/// several spacings, too.
///
/// The search measures all points of the cloud, places around them and around the points of the
/// candidate; in later tries only where points changed. Once none of these is too far, it measures
/// more places where distances are large or the candidate's surface is uneven. Then the result is
/// measured independently: at random places of each surface, twice as many as the cloud has points,
/// at least 200,000, but no more than 300,000 or a hundred per point of the result; at more of them
/// around large distances; at the points of the result; and three times as `measure_error` does
/// with no options. All must be within 97 % of the bound; otherwise the search continues from the
/// result, in larger steps after 32 rounds. A maximum over samples is below that over the whole
/// surface, so another measurement may find slightly more: the last 3 % are for this.
///
/// Large distances are confirmed as `measure_error` does: places in clusters of points without a
/// normal do not count as surface, and a distance is no larger than that of a nearby place plus the
/// way there. A measurement without this confirmation may report more. Therefore the search
/// continues until neither rule is needed any more, also at another 800,000 places or as many as
/// before, unless that takes more than a quarter of the points again.
///
/// Borders stay where they are to the bound, too: a surface ends at the hull of its points, although
/// the planes through neighbours go on there, and a place beyond is as far from it as from the hull,
/// of the 96 points nearest to it. No places are looked for beyond.
///
/// A search ends, whatever it has, once it has looked at 60 million places, 150 more for each of a
/// million points of the cloud, and 25 for each of the others, a round as one for each point, as it
/// may where the bound is just above the noise: with what holds so far, or else with a coarse
/// snapshot that does (`ended_early`).
///
/// If no smaller cloud is within the bound, the result is the input itself, with an error of 0. Of
/// 50,000 points and more, clouds of more than half of them are not looked for, but for snapshots
/// that seem to hold.
///
/// Noise: a point of the input that is farther than 95 % of the bound from the input's own surface
/// is no place of that surface. It is not measured, in the input or in a result that kept it. If
/// more than one point in a hundred is so far off, the bound is below the noise: the result is the
/// input, and `too_far` has all its points, and the one farthest from its own surface.
///
/// @throws Error(InvalidArgument) for a bound that is not finite and positive, a method that is not
/// one of `kErrorBoundedMethods`, other options out of range, or a cloud without points;
/// Error(TooLarge) for more than 1.25e9 points of which 100,000 are not enough.
///
/// Time: mostly one run of the method, seldom two (for particles one for each of up to 50 counts),
/// a measurement, and a tenth of one for each of some tens of other `tries`; where the bound is
/// just above the noise, or the density very uneven, up to 60 million places, which take minutes
/// for clouds of any size. Memory: that of the method, three clouds, and 60 bytes for each place
/// measured.
ErrorBoundedCloud simplify_within_error(const PointCloud& cloud, const SimplifyOptions& options,
                                        const RunContext& context = {});

/// The method of a curve, and its counts.
struct ErrorCurveOptions {
    SimplifyOptions simplification{};     ///< the method and its options, without a target
    std::vector<std::uint64_t> points{};  ///< counts, ascending, each at least 1; those that the
                                          ///< cloud does not have are omitted. Empty: chosen
    unsigned count = 24;                  ///< how many counts are chosen (`curve_counts`), 2..64
};
/// Checks what can be checked without a cloud.
/// @throws Error(InvalidArgument).
void validate(const ErrorCurveOptions& options);
/// The counts for a cloud, descending.
/// @throws Error(InvalidArgument) if the cloud has none of them.
std::vector<std::uint64_t> curve_counts(std::uint64_t points, const ErrorCurveOptions& options);

/// A point of the count-error curve.
struct CurvePoint {
    std::uint64_t points = 0;
    SurfaceError error;
};

/// `count` counts for a curve, evenly spaced on a logarithmic axis, descending: from half of the
/// `points`, at most a million, down to a thousandth of them, at least 20. Fewer if there are not
/// that many.
/// @throws Error(InvalidArgument) for more than 64.
std::vector<std::uint64_t> curve_counts(std::uint64_t points, unsigned count = 24);

/// How the error grows with fewer points: snapshots of one run (particles: one run for each) at the
/// counts of the options (`curve_counts`), each measured by `measure_error` with `measure`. With
/// multiphase, `simplify` to one of them alone may give half or twice the error.
///
/// @param on_point  called for each count, descending, on the calling thread.
/// @throws Error(InvalidArgument) like `curve_counts`, or for a cloud without points.
///
/// Time: one run of the method and a measurement for each count.
void error_curve(const PointCloud& cloud, const ErrorCurveOptions& options,
                 const std::function<void(const CurvePoint&)>& on_point,
                 const SurfaceErrorOptions& measure = {}, const RunContext& context = {});

}  // namespace stipple
