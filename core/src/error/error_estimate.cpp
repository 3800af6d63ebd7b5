#include "error/error_estimate.hpp"

#include "base/distance_statistics.hpp"
#include "cloud/boxed_cloud.hpp"
#include "error/error_samples.hpp"
#include "error/far_clouds.hpp"
#include "error/foot_distance.hpp"
#include "error/local_surface.hpp"
#include "stipple/surface_error.hpp"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace stipple {

namespace {

/// One of two surfaces, and where the distance from it to the other is measured.
struct Side {
    LocalSurface surface;
    ErrorSamples samples;
    std::shared_ptr<const LocalSurface::Part> part;
    LonePoints some;
    std::optional<LonePoints> points;  ///< of the part

    Side(const BoxedCloud& cloud, const ErrorFrame& frame, const SurfaceErrorOptions& options,
         const FootFinder::Options& finding, const RunContext& context)
        : surface(cloud, frame, options.samples, finding, context),
          some(surface.some().points, surface.some().tree) {
        constexpr std::uint64_t kFew = 1'000;  // points, of which the areas of all are soon known
        if (surface.size() > kFew) {
            samples = draw_points_by_area(some, options.samples, options.seed, context);
        } else {
            samples.positions = draw_points(some, options.samples, options.seed, context);
        }
    }

    /// Makes what lies around the samples ready, for so many points each, and within other balls.
    void look_at(std::span<const Ball> others, std::size_t around, const RunContext& context) {
        std::vector<Ball> balls = surface.views(samples.positions, around, context);
        balls.insert(balls.end(), others.begin(), others.end());
        part = surface.gather(balls, context);
        points.emplace(part->points, part->tree, some,
                       static_cast<double>(surface.size()) /
                           static_cast<double>(surface.some().points.size()));
        auto [areas, doubtful_sq] = areas_around(*points, samples.positions, context);
        samples.doubtful_sq = std::move(doubtful_sq);
        if (samples.areas.empty()) return samples.areas.assign(samples.positions.size(), 1.0F);
        for (std::size_t i = 0; i < areas.size(); ++i)
            samples.areas[i] = areas[i] / samples.areas[i];
    }

    /// From points to places beside them.
    void leave_points(const SurfaceErrorOptions& options, const RunContext& context) {
        samples.positions =
            places_beside(*points, part->finder, samples.positions, options.seed, context);
    }
};

/// What the feet of samples say, as something finds them: find(found), as `FootFinder::find`.
///
/// A place that was drawn several times, as a stray point is that stands for a wide area, counts as
/// one with the weight of all: as many that agree it would make the mean look sure.
template <typename Find>
DirectedError estimate_direction(const ErrorSamples& samples, const ErrorFrame& frame,
                                 const RunContext& context, Find&& find) {
    std::vector<float> distances(samples.size());
    std::vector<std::uint8_t> endless(samples.size());
    std::vector<float> covers(samples.size());
    find([&](std::size_t i, const Foot& foot) {
        distances[i] = static_cast<float>(distance_of(foot, samples.doubtful_sq[i]));
        endless[i] = !foot.converged && !foot.beyond;
        covers[i] = static_cast<float>(foot.to_sample);
    });
    std::vector<float> areas;
    for (std::size_t i = 0; i < samples.size(); ++i) {
        if (i > 0 && samples.positions[i] == samples.positions[i - 1]) {
            areas.back() += samples.areas[i];
            continue;
        }
        const std::size_t to = areas.size();
        distances[to] = distances[i], endless[to] = endless[i], covers[to] = covers[i];
        areas.push_back(samples.areas[i]);
    }
    const auto first = [n = areas.size()](auto& values) { return std::span(values).first(n); };
    return summarize_places(first(distances), areas, first(endless), first(covers), frame, context);
}

}  // namespace

SurfaceErrorOptions quick_options(std::uint64_t reference_points, std::uint64_t candidate_points) {
    constexpr std::uint64_t kLeast = 160, kMost = 800, kPart = 750;
    const std::uint64_t points = std::max(reference_points, candidate_points);
    SurfaceErrorOptions options;
    options.samples = std::clamp(points / kPart, kLeast, kMost);
    options.sampling = points < kEnoughSamples ? ErrorSampling::Surface : ErrorSampling::Points;
    options.histogram_bins = 1;
    return options;
}

SurfaceError estimate_error(const PointCloud& reference, const PointCloud& candidate,
                            const RunContext& context) {
    const SurfaceErrorOptions options = quick_options(reference.size(), candidate.size());
    const BoxedCloud boxed_reference(reference, "reference"), boxed(candidate, "candidate");
    const ErrorFrame frame(boxed_reference);
    frame.require_reach(boxed);
    context.throw_if_stopped();
    if (auto far = measure_far(boxed_reference, boxed, options, context)) return std::move(*far);
    const FootFinder::Options finding = {
        .k = options.k, .max_iterations = options.max_iterations, .tolerance = options.tolerance};
    Side S(boxed_reference, frame, options, finding, context);
    context.checkpoint(0.3);
    Side S_prime(boxed, frame, options, finding, context);
    context.checkpoint(0.4);
    constexpr std::size_t kForFeet = LocalSurface::kForFeet;
    // The finer is only looked at where the coarser is known to need it, and gives points.
    const bool reference_is_finer = reference.size() >= candidate.size();
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
    error.diagonal = boxed_reference.box.diagonal();
    error.candidate_diagonal = boxed.box.diagonal();
    DirectedError &from_finer = reference_is_finer ? error.forward : error.backward,
                  &from_coarser = reference_is_finer ? error.backward : error.forward;
    from_finer = estimate_direction(finer.samples, frame, context, [&](const auto& found) {
        coarser.surface.find(*coarser.part, on_coarser, found, context);
    });
    from_coarser = estimate_direction(coarser.samples, frame, context, [&](const auto& found) {
        finer.surface.find(*finer.part, on_finer, found, context);
    });
    return error;
}

DirectedError summarize_places(std::span<const float> distances, std::span<const float> areas,
                               std::span<const std::uint8_t> endless, std::span<const float> covers,
                               const ErrorFrame& frame, const RunContext& context) {
    std::vector<float> lengths(distances.begin(), distances.end());
    for (float& length : lengths)
        length = static_cast<float>(static_cast<double>(length) / frame.scale);
    DirectedError error = summarize_distances(lengths, areas, 1, context);
    error.not_converged =
        static_cast<double>(std::ranges::count(endless, 1)) / static_cast<double>(endless.size());
    error.cover_radius = static_cast<double>(std::ranges::max(covers)) / frame.scale;
    return error;
}

DirectedError estimate_backward(const FramedSurface& reference, std::span<const Vec3f> candidate,
                                const PointTree& tree, const ErrorFrame& frame,
                                const RunContext& context) {
    const SurfaceErrorOptions options = quick_options(reference.points.size(), candidate.size());
    const LonePoints points(candidate, tree);
    ErrorSamples samples = take_points_by_area(points, options.samples, options.seed, context);
    samples.positions = places_beside(points, FootFinder(candidate, tree, FootFinder::Options{}),
                                      samples.positions, options.seed, context);
    return estimate_direction(samples, frame, context, [&](const auto& found) {
        reference.finder.find(samples.positions, found, context);
    });
}

}  // namespace stipple
