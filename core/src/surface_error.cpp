#include "stipple/surface_error.hpp"

#include "attribute_error.hpp"
#include "distance_statistics.hpp"
#include "error_samples.hpp"
#include "foot_finder.hpp"
#include "parallel_for.hpp"
#include "point_tree.hpp"
#include "stipple/error.hpp"
#include "tree_search.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <string>

// Follows: Pauly, Gross, Kobbelt 2002, §4; Cignoni, Rocchini, Scopigno 1998 (Metro: distances from
// samples of one surface to the other, both ways). Where the paper says "the closest point" a fixed
// point of an iteration is found (foot_finder.hpp), for which several exist on folded surfaces.

namespace stipple {

namespace {

constexpr std::uint64_t kLeastSamples = 100'000;

[[noreturn]] void refuse(const std::string& what) {
    throw Error(ErrorCode::InvalidArgument, what);
}

void check_positions(const PointCloud& cloud, const std::string& which) {
    validate(cloud);
    if (cloud.empty()) refuse(which + " 0 points: expected at least 1");
    const auto finite = [](const Vec3f& p) { return p.allFinite(); };
    const auto bad = std::ranges::find_if_not(cloud.positions, finite);
    if (bad != cloud.positions.end() || !cloud.origin.allFinite())
        refuse(which + " point " + std::to_string(bad - cloud.positions.begin()) +
               ": expected finite coordinates");
}

void check(const PointCloud& reference, const PointCloud& candidate,
           const SurfaceErrorOptions& options) {
    if (options.k < 6 || options.k > 64)
        refuse("k " + std::to_string(options.k) + ": expected 6..64");
    if (options.max_iterations == 0) refuse("max_iterations 0: expected at least 1");
    if (!(options.tolerance > 0 && options.tolerance < 1))
        refuse("tolerance " + std::to_string(options.tolerance) +
               ": expected a part of h above 0 and below 1");
    if (options.histogram_bins == 0 || options.histogram_bins > 65'536)
        refuse("histogram_bins " + std::to_string(options.histogram_bins) + ": expected 1..65536");
    constexpr std::uint64_t kMostSamples = std::uint64_t{1} << 31U;
    if (options.samples > kMostSamples)
        refuse("samples " + std::to_string(options.samples) + ": expected at most 2^31");
    check_positions(reference, "reference");
    check_positions(candidate, "candidate");
}

/// Brings both clouds to where floats are at their best, and back: the middle of the reference's
/// box lies at 0, and its diagonal is between 1 and 2.
struct Frame {
    Vec3d center = Vec3d::Zero();
    double scale = 1;  ///< a power of two

    explicit Frame(const PointCloud& reference) {
        const Aabb box = bounds(reference);
        center = 0.5 * (box.min + box.max);
        if (box.diagonal() > 0) scale = std::ldexp(1.0, -std::ilogb(box.diagonal()));
    }
    std::vector<Vec3f> into(const PointCloud& cloud) const {
        const Vec3d shift = cloud.origin - center;
        std::vector<Vec3f> points(cloud.size());
        for (std::size_t i = 0; i < points.size(); ++i)
            points[i] = (scale * (cloud.positions[i].cast<double>() + shift)).cast<float>();
        return points;
    }
};

/// One of the two surfaces.
struct Surface {
    const PointCloud& cloud;
    std::vector<Vec3f> points;
    PointTree tree;
    FootFinder finder;

    Surface(const PointCloud& cloud_, const Frame& frame, const FootFinder::Options& options,
            const RunContext& context)
        : cloud(cloud_),
          points(frame.into(cloud_)),
          tree(points, PointTree::Leaves::Compact, context),
          finder(points, tree, options) {}
    Surface(const Surface&) = delete;
    Surface& operator=(const Surface&) = delete;

    AttributedSurface attributed() const { return {cloud, tree}; }
};

ErrorSamples take_samples(const Surface& surface, const SurfaceErrorOptions& options,
                          const RunContext& context) {
    const std::uint64_t n = surface.points.size();
    const std::uint64_t count = options.samples > 0 ? options.samples : std::max(n, kLeastSamples);
    const bool at_points = options.sampling == ErrorSampling::Points && count <= n;
    if (at_points || options.surface == ErrorSurface::Samples)
        return take_points(surface.tree, count, options.seed, context);
    if (options.sampling == ErrorSampling::Particles)
        return take_particles(surface.points, surface.tree, surface.finder, count, options.seed,
                              context);
    return take_surface(surface.tree, surface.finder, count, options.seed, context);
}

/// Distances to the nearest of the points.
void find_nearest_points(const Surface& surface, std::span<const Vec3f> queries,
                         const std::function<void(std::size_t, const Foot&)>& found,
                         const RunContext& context) {
    parallel_for_blocks(queries.size(), 2048, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            Neighbor nearest;
            find_nearest(surface.tree, queries[i], {&nearest, 1});
            const Vec3d point = surface.points[nearest.index].cast<double>();
            found(i, {.point = point,
                      .distance = (queries[i].cast<double>() - point).norm(),
                      .converged = true});
        }
    });
}

DirectedError measure_direction(const Surface& from, const Surface& to, const Frame& frame,
                                const SurfaceErrorOptions& options, const RunContext& context) {
    ErrorSamples samples = take_samples(from, options, context.part(0.0, 0.5));
    context.checkpoint(0.5);
    std::vector<float> distances(samples.size());
    std::vector<Vec3f> feet(options.attributes ? samples.size() : 0);
    std::atomic<std::uint64_t> failed = 0;
    const auto found = [&](std::size_t i, const Foot& foot) {
        distances[i] = static_cast<float>(foot.distance / frame.scale);
        if (options.attributes) feet[i] = foot.point.cast<float>();
        if (!foot.converged && !foot.beyond) ++failed;
    };
    if (options.surface == ErrorSurface::Samples) {
        find_nearest_points(to, samples.positions, found, context);
    } else {
        to.finder.find(samples.positions, found, context);
    }
    context.checkpoint(0.9);

    DirectedError error = summarize_distances(distances, samples.areas, options.histogram_bins);
    error.not_converged = static_cast<double>(failed) / static_cast<double>(samples.size());
    if (options.attributes)
        error.attributes = attribute_errors(from.attributed(), to.attributed(), samples.positions,
                                            feet, samples.areas, options.k, context);
    if (options.keep_samples) {
        error.distances = std::move(distances);
        error.positions = std::move(samples.positions);
    }
    return error;
}

}  // namespace

double SurfaceError::max() const noexcept {
    return std::max(forward.max, backward.max);
}
double SurfaceError::mean() const noexcept {
    return forward.mean;
}
double SurfaceError::rms() const noexcept {
    return forward.rms;
}

SurfaceError measure_error(const PointCloud& reference, const PointCloud& candidate,
                           const SurfaceErrorOptions& options, const RunContext& context) {
    check(reference, candidate, options);
    const Frame frame(reference);
    const FootFinder::Options finding = {
        .k = options.k,
        .degree = options.surface == ErrorSurface::Quadratic ? 2U : 1U,
        .max_iterations = options.max_iterations,
        .tolerance = options.tolerance};
    const Surface S(reference, frame, finding, context);
    const Surface S_prime(candidate, frame, finding, context);
    context.checkpoint(0.2);
    SurfaceError error;
    error.diagonal = bounds(reference).diagonal();
    error.forward = measure_direction(S, S_prime, frame, options, context.part(0.2, 0.6));
    error.backward = measure_direction(S_prime, S, frame, options, context.part(0.6, 1.0));
    for (DirectedError* const direction : {&error.forward, &error.backward}) {
        for (Vec3f& p : direction->positions)
            p = (p.cast<double>() / frame.scale + frame.center - reference.origin).cast<float>();
    }
    return error;
}

}  // namespace stipple
