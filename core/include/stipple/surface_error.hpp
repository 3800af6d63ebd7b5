#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace stipple {

/// Where on a surface distances are taken: the cloud Q of §4.
enum class ErrorSampling : std::uint8_t {
    Points,   ///< at the points themselves, each weighted by the area around it; like `Surface` on
              ///< the coarser of two clouds, whose points may all lie on the other surface, and if
              ///< there are fewer points than requested samples. Points have noise, and a linear
              ///< surface lies inside its curves: so a cloud has a distance from itself, which is 0
              ///< for places on its surface
    Surface,  ///< at random places of the surface: evenly over its area, but hardly in gaps between
              ///< points that are unusually wide for their surroundings
    Particles,  ///< at particles that repel each other on the surface (§3.3), as in the paper
};

/// What represents the surface of a cloud.
enum class ErrorSurface : std::uint8_t {
    Linear,     ///< MLS with a linear basis, as in the paper; lies inside curved parts
    Quadratic,  ///< MLS with a quadratic basis, an order closer to the true surface
    Samples,    ///< the points alone, without a surface, and measured only from points: of a subset
                ///< `backward` is zero
};

struct SurfaceErrorOptions {
    ErrorSampling sampling = ErrorSampling::Points;
    std::uint64_t samples = 0;  ///< on each surface; 0: chosen, see `measure_error`
    ErrorSurface surface = ErrorSurface::Linear;
    unsigned k = 20;               ///< neighbours of the MLS surfaces, 6..64; h = r / 3
    unsigned max_iterations = 30;  ///< to find a foot point; >= 1
    double tolerance = 1e-3;       ///< a foot point has converged when it moves by less than this
                                   ///< fraction of h; > 0, < 1
    unsigned histogram_bins = 64;  ///< of equal width, 1..65,536
    bool attributes = false;       ///< also compare colours, normals and scalars
    bool keep_samples = false;  ///< keep every sample and its distance, for a coloured map: with 0
                                ///< samples all points of the finer cloud
    std::uint64_t seed = 0;     ///< for the random samples
};

/// What the samples of the finer of two clouds are: places on its surface where it has fewer points
/// than they are to be.
ErrorSampling sampling_of(const SurfaceErrorOptions& options, std::uint64_t reference_points,
                          std::uint64_t candidate_points) noexcept;

/// How much an attribute differs, over the samples, weighted by area like the distances.
struct AttributeError {
    std::string name;  ///< `color` (CIEDE2000), `normal` (angle in radians), or the name of the
                       ///< attribute (absolute difference; Euclidean for several components)
    double max = 0;
    double mean = 0;
    double rms = 0;
    std::optional<double> differing{};  ///< fraction of the area where the value is another one, as
                                        ///< of labels; absent for what is averaged
};

/// Distances from one surface to another, in input units.
struct DirectedError {
    double max = 0;
    std::optional<Vec3d> max_at{};  ///< where: a place of the surface that the distance is from,
                                    ///< not relative to an origin. Only of `measure_error`, and
                                    ///< absent for clouds far apart
    double mean = 0;                ///< weighted by area
    double mean_confidence = 0;  ///< half width of the 95 % confidence interval of the mean; 0 for
                                 ///< a single sample, whose confidence is unknown
    double rms = 0;
    double p50 = 0, p95 = 0, p99 = 0;  ///< distances that 50, 95 and 99 % of the area do not exceed
    std::vector<double> histogram;     ///< fractions of the area, in bins from 0 to `max`
    std::uint64_t samples = 0;
    double not_converged = 0;  ///< fraction of the samples whose foot point did not converge: the
                               ///< closest approach, or the nearest sample, is used instead
    std::optional<double>
        cover_radius{};  ///< largest distance from a sample to the nearest point of the other
                         ///< cloud: a surface may bridge holes that points leave. Absent for
                         ///< clouds far apart and results of `simplify_within_error`
    std::vector<AttributeError> attributes;  ///< of both clouds, where any values are known

    std::vector<Vec3f> positions;  ///< of the samples, relative to the reference's origin; like the
                                   ///< distances, empty unless kept
    std::vector<float> distances;
};

/// The error of a candidate P' as an approximation of a reference P. Lengths are in input units;
/// relative lengths are divided by `diagonal`.
struct SurfaceError {
    DirectedError forward;          ///< from S to S'
    DirectedError backward;         ///< from S' to S
    double diagonal = 0;            ///< of the reference's box; 0 if all its points coincide
    double candidate_diagonal = 0;  ///< of the candidate's box

    double max() const noexcept;   ///< Δ_max (Eq. 9): of both directions
    double mean() const noexcept;  ///< Δ_avg (Eq. 10): from S to S'
    double rms() const noexcept;   ///< from S to S'
};

/// Checks what can be checked without clouds.
/// @throws Error(InvalidArgument) with the option, its value and the limit.
void validate(const SurfaceErrorOptions& options);

/// Measures the distance between the surfaces of two clouds (§4, Eq. 9-10), in both directions.
///
/// For each sample q of one surface, the foot point q' on the other is found, where q - q' is
/// perpendicular to the surface: iterate x <- q - (n . (q - a)) n, with the plane (a, n) of x's
/// neighbours, until x converges. The surface is thus the same for every query. The iteration
/// starts from q and, if that leads far away, from the nearest sample; the nearer foot point
/// counts. The surface ends where its samples end: d is at least the distance to the nearest sample
/// minus the radius of its k-neighbourhood. If neighbours coincide, the nearest sample counts. The
/// largest distances are checked again, so that a sample that lies on no surface or missed a nearer
/// foot point cannot be the maximum: d changes by no more than q moves.
///
/// Where neighbours lie on a line, as those of a wire do, their plane is any of many, and the foot
/// is on the line instead, by weighted least squares with h / 4 (2 / sqrt(pi k) of it in general),
/// which reaches as far on a line as h on a surface: of the weighted covariance λ1 / λ2 is at most
/// 0.0002, or at most 0.004 with λ0 / λ1 at least 0.2. Up to 0.0008, or 0.016 and 0.05, it is
/// between both, so that distances do not leap.
///
/// With 0 samples: at `Points`, the finer cloud's mean, root mean square, percentiles and histogram
/// come from 40,000 of its points, and the maximum from all of them: since a distance changes by no
/// more than the way between two points, most need not be measured. On the other cloud, and on both
/// with other `sampling`, there are as many places as points, at least 40,000, and the maximum is
/// refined at 4,096 more around the farthest. With fewer samples than points, points that represent
/// large areas are drawn more often; with fewer than 2,048 the largest distances are not refined.
/// No point represents more than half the square about most of the points: a single far-off point
/// would otherwise dominate the mean.
///
/// With the linear basis, S and S' both lie inside curved parts by about h^2 kappa / 2, the coarser
/// one more: before calling one candidate better, compare them with `Quadratic` as well.
///
/// If all points of one cloud are farther from the other than a hundred of its diagonals, so that
/// it is practically a point, distances to its centre are used for all, unless attributes are
/// requested: such clouds can hardly be compared, and the caller should learn this at once.
///
/// The clouds may have different origins. Positions must be finite (`clean`).
/// @throws Error(InvalidArgument) for an empty cloud, a position that is not finite or an option
/// out of range; Error(MalformedInput) if the candidate reaches 1e15 times the reference's width.
///
/// O(N log N), parallel, the same for any number of threads: about 0.15 us per point, 2 us per
/// sample of the finer cloud and 8 us per sample of the coarser, ten times that with `Particles`;
/// 60 bytes per point and 24 per sample.
SurfaceError measure_error(const PointCloud& reference, const PointCloud& candidate,
                           const SurfaceErrorOptions& options = {}, const RunContext& context = {});

/// The same for several candidates, one after the other: the reference is analysed once, and its
/// samples are drawn once.
class SurfaceErrorMeter {
public:
    /// @param reference  must outlive the meter.
    /// @throws Error(InvalidArgument) like `measure_error`.
    explicit SurfaceErrorMeter(const PointCloud& reference, const SurfaceErrorOptions& options = {},
                               const RunContext& context = {});
    ~SurfaceErrorMeter();
    SurfaceErrorMeter(const SurfaceErrorMeter&) = delete;
    SurfaceErrorMeter& operator=(const SurfaceErrorMeter&) = delete;

    /// @throws as `measure_error`.
    SurfaceError measure(const PointCloud& candidate, const RunContext& context = {});
    /// With a number of samples and a seed other than those of the options. Samples on the
    /// reference are kept for repeated use, the last for each seed.
    SurfaceError measure(const PointCloud& candidate, std::uint64_t samples, std::uint64_t seed,
                         const RunContext& context = {});

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// The options of `estimate_error`: distances at one in 750 points of the larger cloud, 160 to 800
/// of them, at points if `measure_error` uses points there.
SurfaceErrorOptions quick_options(std::uint64_t reference_points, std::uint64_t candidate_points);

/// An estimate of `measure_error` from few samples, in a small fraction of the time it took to make
/// the candidate: only the surroundings of the samples get a tree. The mean is off by the sampling
/// error of so few samples (`mean_confidence`), and by more if a cloud of more than 100,000 points
/// has large parts with hardly any of them. The maximum is the largest distance met, a lower bound.
///
/// @throws as `measure_error`.
///
/// About 12 ns per point of large clouds, and 15 us per sample on one core; about 5 bytes per point
/// of a large cloud.
SurfaceError estimate_error(const PointCloud& reference, const PointCloud& candidate,
                            const RunContext& context = {});

}  // namespace stipple
