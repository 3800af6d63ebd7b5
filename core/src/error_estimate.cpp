#include "error_estimate.hpp"

#include "boxed_cloud.hpp"
#include "distance_statistics.hpp"
#include "error_frame.hpp"
#include "error_samples.hpp"
#include "far_clouds.hpp"
#include "local_surface.hpp"
#include "stipple/surface_error.hpp"

#include <algorithm>
#include <memory>
#include <span>
#include <vector>

namespace stipple {

namespace {

/// One of two surfaces, and where the distance from it to the other is measured.
struct Side {
    LocalSurface surface;
    ErrorSamples samples;
    std::shared_ptr<const LocalSurface::Part> part;

    Side(const BoxedCloud& cloud, const ErrorFrame& frame, const SurfaceErrorOptions& options,
         const RunContext& context)
        : Side(LocalSurface(cloud, frame, options.samples, finding(options), context), options,
               context) {}

    Side(LocalSurface&& surface_, const SurfaceErrorOptions& options, const RunContext& context)
        : surface(std::move(surface_)) {
        constexpr std::uint64_t kFew = 1'000;  // points, of which the areas of all are soon known
        const PointTree& tree = surface.some().tree;
        if (surface.size() > kFew) {
            samples = draw_points_by_area(tree, options.samples, options.seed, context);
        } else {
            samples.positions = draw_points(tree, options.samples, options.seed, context);
        }
    }

    /// Makes what lies around the samples ready, for so many points each, and within other balls.
    void look_at(std::span<const Ball> others, std::size_t around, const RunContext& context) {
        std::vector<Ball> balls = surface.views(samples.positions, around, context);
        balls.insert(balls.end(), others.begin(), others.end());
        part = surface.gather(balls, context);
        if (samples.areas.empty()) return samples.areas.assign(samples.positions.size(), 1.0F);
        const std::vector<float> areas = areas_around(part->tree, samples.positions, context);
        for (std::size_t i = 0; i < areas.size(); ++i)
            samples.areas[i] = areas[i] / samples.areas[i];
    }

    static FootFinder::Options finding(const SurfaceErrorOptions& options) {
        return {.k = options.k,
                .max_iterations = options.max_iterations,
                .tolerance = options.tolerance};
    }

    /// From points to places beside them.
    void leave_points(const SurfaceErrorOptions& options, const RunContext& context) {
        samples.positions = places_beside(part->points, part->tree, part->finder, samples.positions,
                                          options.seed, context);
    }
};

DirectedError estimate_direction(const Side& from, const Side& to, std::span<const Ball> views,
                                 const ErrorFrame& frame, const SurfaceErrorOptions& options,
                                 const RunContext& context) {
    std::vector<float> lengths(views.size());
    std::uint64_t failed = 0;
    const auto found = [&](std::size_t i, const Foot& foot) {
        lengths[i] = static_cast<float>(foot.distance / frame.scale);
        if (!foot.converged && !foot.beyond) ++failed;
    };
    to.surface.find(*to.part, views, found, context);
    DirectedError error =
        summarize_distances(lengths, from.samples.areas, options.histogram_bins, context);
    error.samples = views.size();
    error.not_converged = static_cast<double>(failed) / static_cast<double>(views.size());
    return error;
}

/// All but the diagonals.
SurfaceError estimate_between(Side& S, Side& S_prime, const ErrorFrame& frame,
                              const SurfaceErrorOptions& options, const RunContext& context) {
    constexpr std::size_t kForFeet = LocalSurface::kForFeet;
    // The finer is only looked at where the coarser is known to need it, and gives points.
    const bool reference_is_finer = S.surface.size() >= S_prime.surface.size();
    Side &finer = reference_is_finer ? S : S_prime, &coarser = reference_is_finer ? S_prime : S;
    if (options.sampling != ErrorSampling::Points) {
        finer.look_at({}, kForFeet, context);
        finer.leave_points(options, context);
    }
    const std::vector<Ball> on_coarser =
        coarser.surface.views(finer.samples.positions, kForFeet, context);
    coarser.look_at(on_coarser, kForFeet, context);
    coarser.leave_points(options, context);
    const std::vector<Ball> on_finer =
        finer.surface.views(coarser.samples.positions, kForFeet, context);
    if (options.sampling == ErrorSampling::Points)
        finer.look_at(on_finer, LocalSurface::kForAreas, context);
    context.checkpoint(0.7);
    SurfaceError error;
    DirectedError &from_finer = reference_is_finer ? error.forward : error.backward,
                  &from_coarser = reference_is_finer ? error.backward : error.forward;
    from_finer = estimate_direction(finer, coarser, on_coarser, frame, options, context);
    from_coarser = estimate_direction(coarser, finer, on_finer, frame, options, context);
    return error;
}

}  // namespace

SurfaceErrorOptions quick_options(std::uint64_t reference_points, std::uint64_t candidate_points) {
    constexpr std::uint64_t kLeast = 160, kMost = 800, kPart = 750;
    constexpr std::uint64_t kMany = 40'000;  // of which `measure_error` takes points themselves
    const std::uint64_t points = std::max(reference_points, candidate_points);
    SurfaceErrorOptions options;
    options.samples = std::clamp(points / kPart, kLeast, kMost);
    options.sampling = points < kMany ? ErrorSampling::Surface : ErrorSampling::Points;
    options.histogram_bins = 1;
    return options;
}

SurfaceError estimate_error(const PointCloud& reference, const PointCloud& candidate,
                            const RunContext& context) {
    const SurfaceErrorOptions options = quick_options(reference.size(), candidate.size());
    const BoxedCloud boxed_reference(reference, "reference"), boxed(candidate, "candidate");
    context.throw_if_stopped();
    if (auto far = measure_far(boxed_reference, boxed, options, context)) return std::move(*far);
    const ErrorFrame frame(boxed_reference);
    Side S(boxed_reference, frame, options, context);
    context.checkpoint(0.3);
    Side S_prime(boxed, frame, options, context);
    context.checkpoint(0.4);
    SurfaceError error = estimate_between(S, S_prime, frame, options, context);
    error.diagonal = boxed_reference.box.diagonal();
    error.candidate_diagonal = boxed.box.diagonal();
    return error;
}

SurfaceError estimate_error(const std::shared_ptr<const FramedSurface>& reference, const Aabb& box,
                            const PointCloud& candidate, const RunContext& context) {
    const SurfaceErrorOptions options = quick_options(reference->points.size(), candidate.size());
    const BoxedCloud boxed(candidate, "candidate");
    const ErrorFrame frame(box);
    Side S(LocalSurface(reference), options, context);
    Side S_prime(boxed, frame, options, context);
    context.checkpoint(0.3);
    SurfaceError error = estimate_between(S, S_prime, frame, options, context);
    error.diagonal = box.diagonal();
    error.candidate_diagonal = boxed.box.diagonal();
    return error;
}

}  // namespace stipple
