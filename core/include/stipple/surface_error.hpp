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
    Points,     ///< at the points themselves, each for the area around it; on the coarser of two
                ///< clouds, whose points may all lie on the other surface, and where there are
                ///< fewer points than samples asked for, as `Surface`. Points have noise, and
                ///< a linear surface lies inside its curves: a cloud is not 0 from itself then,
                ///< as it is where places lie on its surface
    Surface,    ///< at random places of the surface: evenly over its area, but hardly in gaps
                ///< between points that are wider than usual there
    Particles,  ///< at particles that repel each other on the surface (§3.3), as the paper has it
};

/// What is taken for the surface of a cloud.
enum class ErrorSurface : std::uint8_t {
    Linear,     ///< MLS with a linear basis, as the paper has it; lies inside curved parts
    Quadratic,  ///< MLS with a quadratic basis, an order closer to the true surface
    Samples,    ///< the points alone, no surface, from points only: zero for any subset
};

struct SurfaceErrorOptions {
    ErrorSampling sampling = ErrorSampling::Points;
    std::uint64_t samples = 0;  ///< on each surface; 0: enough, see `measure_error`
    ErrorSurface surface = ErrorSurface::Linear;
    unsigned k = 20;               ///< neighbours of the MLS surfaces, 6..64; h = r / 3
    unsigned max_iterations = 30;  ///< until a foot stays where it is; >= 1
    double tolerance = 1e-3;       ///< a foot moves by less than this part of h; > 0, < 1
    unsigned histogram_bins = 64;  ///< of equal width, 1..65,536
    bool attributes = false;       ///< colour, normals and scalars too
    bool keep_samples = false;     ///< every sample and its distance, for a coloured map: with 0
                                   ///< samples all points of the finer cloud
    std::uint64_t seed = 0;        ///< of the random samples
};

/// How much an attribute differs, over the samples: by area, as the distances.
struct AttributeError {
    std::string name;  ///< `color` (CIEDE2000), `normal` (angle in radians), or that of the
                       ///< attribute (absolute difference; Euclidean where it has components)
    double max = 0;
    double mean = 0;
    double rms = 0;
};

/// Distances from one surface to another, in input units.
struct DirectedError {
    double max = 0;
    double mean = 0;             ///< by area
    double mean_confidence = 0;  ///< the mean is within so much of that for infinitely many
                                 ///< samples, in 95 of 100 cases; 0 of a single one, unknown
    double rms = 0;
    double p50 = 0, p95 = 0, p99 = 0;  ///< distances that so much of the area does not exceed
    std::vector<double> histogram;     ///< shares of the area, in bins from 0 to `max`
    std::uint64_t samples = 0;
    double not_converged = 0;  ///< share of the samples whose foot is no fixed point: the closest
                               ///< to one that was met, or the nearest sample, stands for it
    std::vector<AttributeError> attributes;  ///< of those that both clouds have

    std::vector<Vec3f> positions;  ///< of the samples, relative to the reference's origin; empty
                                   ///< unless kept, as are the distances
    std::vector<float> distances;
};

/// The error of a candidate P' as an approximation of a reference P. Lengths are in input units; as
/// a part of the diagonal they are divided by `diagonal`.
struct SurfaceError {
    DirectedError forward;          ///< from S to S'
    DirectedError backward;         ///< from S' to S
    double diagonal = 0;            ///< of the reference's box; 0 where all its points coincide
    double candidate_diagonal = 0;  ///< of the candidate's box

    double max() const noexcept;   ///< Δ_max (Eq. 9): of both directions
    double mean() const noexcept;  ///< Δ_avg (Eq. 10): from S to S'
    double rms() const noexcept;   ///< from S to S'
};

/// Checks what can be checked without clouds. @throws Error(InvalidArgument) with the option, its
/// value and the limit.
void validate(const SurfaceErrorOptions& options);

/// Measures the distance between the surfaces of two clouds (§4, Eq. 9-10), in both directions.
///
/// For each sample q of one surface the foot q' on the other is found, with q - q' across the
/// surface there: x <- q - (n . (q - a)) n, the plane of x's neighbours anew each time, until x
/// stays. The surface is thus the same for every query. The iteration starts from q and, where that
/// leads far, from the nearest sample; the nearer foot counts. The surface ends where its samples
/// end: d is at least the distance to the nearest sample less the radius of its k-neighbourhood.
/// Where neighbours carry no plane (a line, fewer than three points) the nearest sample counts. The
/// largest distances are looked at again, so that the maximum is none of a sample that lies on no
/// surface or missed a nearer foot: d changes by no more than the way that q goes.
///
/// With 0 samples: at `Points`, the finer cloud's mean, root mean square, percentiles and histogram
/// are those of 40,000 of its points, and the maximum is that of all: a distance changes by no more
/// than the way between two points, so that most need not be looked at. On the other cloud, as on
/// both with other `sampling`, there are as many places as points, at least 40,000, and the maximum
/// is looked for at 4,096 more around the farthest. With fewer samples than points those that stand
/// for large areas are drawn more often; of fewer than 2,048 the largest distances stay as found.
/// No point stands for more than half the square about most of the points: one far off all others
/// would else decide the mean.
///
/// With the linear basis S and S' both lie inside curved parts by about h^2 kappa / 2, the coarser
/// one more: compare candidates with `Quadratic` as well before one is called better.
///
/// Where one cloud is as good as a point for the other, all of whose points are farther from it
/// than a hundred of its diagonals, distances to its middle stand for all, unless attributes are
/// asked for: such clouds can hardly be compared, and that is to be known at once.
///
/// The clouds may have different origins. Positions must be finite (`clean`).
/// @throws Error(InvalidArgument) for an empty cloud, a position that is not finite or an option
/// out of range.
/// O(N log N), parallel, the same for any number of threads: about 0.15 us for each point, 2 us for
/// each sample of the finer cloud and 8 us for each of the coarser; 60 bytes a point and 24 a
/// sample.
SurfaceError measure_error(const PointCloud& reference, const PointCloud& candidate,
                           const SurfaceErrorOptions& options = {}, const RunContext& context = {});

/// The same for several candidates, one after the other: what is to be known of the reference is
/// found once, and its samples are drawn once.
class SurfaceErrorMeter {
public:
    /// @param reference  must outlive the meter. @throws Error(InvalidArgument).
    explicit SurfaceErrorMeter(const PointCloud& reference, const SurfaceErrorOptions& options = {},
                               const RunContext& context = {});
    ~SurfaceErrorMeter();
    SurfaceErrorMeter(const SurfaceErrorMeter&) = delete;
    SurfaceErrorMeter& operator=(const SurfaceErrorMeter&) = delete;

    /// @throws Error(InvalidArgument) for a candidate without points, or with one not finite.
    SurfaceError measure(const PointCloud& candidate, const RunContext& context = {});
    /// At another number of places, drawn by another seed, than the options say. Those on the
    /// reference that are asked for twice are kept, for each seed the last.
    SurfaceError measure(const PointCloud& candidate, std::uint64_t samples, std::uint64_t seed,
                         const RunContext& context = {});

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// The options of `estimate_error`: distances at one of 750 points of the larger cloud, 160 to
/// 800 of them, at points where `measure_error` takes them there.
SurfaceErrorOptions quick_options(std::uint64_t reference_points, std::uint64_t candidate_points);

/// What `measure_error` says, by a few samples, in a small part of the time that it took to make
/// the candidate: only what lies around the samples gets a tree. The mean is off by what so few
/// samples leave to chance (`mean_confidence`), more where a cloud of more than 100,000 points has
/// large parts with hardly any of them; the maximum is what was met, which is less than there is.
///
/// @throws Error(InvalidArgument) as `measure_error`. About 12 ns for each point of large clouds,
/// and 15 us for each sample on one core; of a large cloud about 5 bytes a point.
SurfaceError estimate_error(const PointCloud& reference, const PointCloud& candidate,
                            const RunContext& context = {});

}  // namespace stipple
