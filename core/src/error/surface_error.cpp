#include "stipple/surface_error.hpp"

#include "base/distance_statistics.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "cloud/boxed_cloud.hpp"
#include "error/attribute_error.hpp"
#include "error/error_frame.hpp"
#include "error/error_samples.hpp"
#include "error/far_clouds.hpp"
#include "error/farthest_places.hpp"
#include "error/foot_distance.hpp"
#include "error/foot_finder.hpp"
#include "error/framed_surface.hpp"
#include "error/worst_samples.hpp"
#include "neighbors/point_tree.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <atomic>
#include <optional>

// Follows: Pauly, Gross, Kobbelt 2002, §4; Cignoni, Rocchini, Scopigno 1998 (Metro: distances from
// samples of one surface to the other, both ways). Where the paper says "the closest point" a fixed
// point of an iteration is found (foot_finder.hpp), for which several exist on folded surfaces.

namespace stipple {

void validate(const SurfaceErrorOptions& options) {
    require(options.k >= 6 && options.k <= 64, "k", options.k, "6..64");
    if (options.max_iterations == 0) refuse("max_iterations 0: expected at least 1");
    require(options.tolerance > 0 && options.tolerance < 1, "tolerance", options.tolerance,
            "a fraction of h, above 0 and below 1");
    require(options.histogram_bins >= 1 && options.histogram_bins <= 65'536, "histogram_bins",
            options.histogram_bins, "1..65536");
    constexpr std::uint64_t kMostSamples = std::uint64_t{1} << 31U;
    require(options.samples <= kMostSamples, "samples", options.samples, "at most 2^31");
}

ErrorSampling sampling_of(const SurfaceErrorOptions& options, std::uint64_t reference_points,
                          std::uint64_t candidate_points) noexcept {
    if (options.surface == ErrorSurface::Samples) return ErrorSampling::Points;
    if (options.sampling != ErrorSampling::Points) return options.sampling;
    const std::uint64_t points = std::max(reference_points, candidate_points);
    const std::uint64_t samples = options.samples > 0 ? options.samples : kEnoughSamples;
    return samples <= points ? ErrorSampling::Points : ErrorSampling::Surface;
}

namespace {

/// One of the two surfaces.
struct Surface : FramedSurface {
    const PointCloud& cloud;
    LonePoints lone_points;

    Surface(const PointCloud& cloud_, const ErrorFrame& frame, PointTree::Leaves leaves,
            const FootFinder::Options& options, const RunContext& context)
        : FramedSurface(frame.into(cloud_, context), leaves, options, context),
          cloud(cloud_),
          lone_points(points, tree) {}

    AttributedSurface attributed() const { return {cloud, tree}; }
};

PointTree::Leaves leaves_of(const PointCloud& cloud, const SurfaceErrorOptions& options) {
    return leaves_for(cloud.size(), options.samples > 0    ? options.samples
                                    : options.keep_samples ? cloud.size()
                                                           : kEnoughSamples);
}

std::uint64_t sample_count(const Surface& surface, const SurfaceErrorOptions& options) {
    if (options.samples > 0) return options.samples;
    const std::uint64_t points = surface.points.size();
    // Particles through a few points crowd, which takes long to come to rest.
    constexpr std::uint64_t kEnoughOfEach = 64;
    const bool crowd = options.sampling == ErrorSampling::Particles;
    return std::max(points,
                    crowd ? std::min(kEnoughSamples, kEnoughOfEach * points) : kEnoughSamples);
}

bool is_finer(const Surface& one, const Surface& other) {
    return one.points.size() >= other.points.size();
}

/// Whether the samples are points of the cloud, and not places on its surface.
/// @param finer  whether it is the finer of the two.
bool at_points(const Surface& surface, bool finer, const SurfaceErrorOptions& options) {
    const std::uint64_t points = surface.points.size();
    return options.surface == ErrorSurface::Samples ||
           (finer && sampling_of(options, points, points) == ErrorSampling::Points);
}

/// Whether the largest distance is looked for beside the samples too.
bool searches(const SurfaceErrorOptions& options) {
    return options.samples == 0 && options.surface != ErrorSurface::Samples;
}

ErrorSamples take_samples(const Surface& surface, bool finer, const SurfaceErrorOptions& options,
                          const RunContext& context) {
    const std::uint64_t count = sample_count(surface, options);
    if (at_points(surface, finer, options)) {
        if (options.keep_samples || options.surface == ErrorSurface::Samples)
            return take_points(surface.lone_points, count, options.seed, context);
        return take_points_by_area(surface.lone_points, searches(options) ? kEnoughSamples : count,
                                   options.seed, context);
    }
    if (options.sampling == ErrorSampling::Particles)
        return take_particles(surface.lone_points, surface.finder, count, options.seed, context);
    constexpr std::uint64_t kFew = 4, kAll = 2'500;  // points for each place, and of a small cloud
    if (surface.points.size() > kAll && count <= surface.points.size() / kFew)
        return take_surface_by_area(surface.lone_points, surface.finder, count, options.seed,
                                    context);
    return take_surface(surface.lone_points, surface.finder, count, options.seed, context);
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
            const double distance = (queries[i].cast<double>() - point).norm();
            found(i,
                  {.point = point, .distance = distance, .to_sample = distance, .converged = true});
        }
    });
}

/// The distances of samples, and of what may be farther: places that stand for no area.
struct MeasuredSamples {
    MeasuredPlaces measured;
    /// Where attributes are compared: the samples as they were taken, and their feet.
    std::vector<Vec3f> taken, feet;
    std::uint64_t failed = 0;
    double cover = 0;  ///< largest distance from a sample to the nearest point
};

MeasuredSamples measure_samples(const Surface& from, const Surface& to, ErrorSamples&& samples,
                                bool are_points, const SurfaceErrorOptions& options,
                                const RunContext& context) {
    MeasuredSamples all;
    auto& [places, distances] = all.measured;
    places = std::move(samples.positions);
    const std::size_t n = places.size();
    distances = made_in_blocks<std::vector<double>>(n, context);
    all.feet = made_in_blocks<std::vector<Vec3f>>(options.attributes ? n : 0, context);
    std::vector<KnownDistance> known(samples.numbers.size());
    std::atomic<std::uint64_t> failed = 0;
    std::atomic<double> cover = 0;
    const auto found = [&](std::size_t i, const Foot& foot) {
        for (double most = cover; most < foot.to_sample;)
            if (cover.compare_exchange_weak(most, foot.to_sample)) break;
        distances[i] = distance_of(foot, from.lone_points, places[i]);
        if (options.attributes) all.feet[i] = foot.point.cast<float>();
        if (!known.empty()) known[i] = known_of(samples.numbers[i], foot, distances[i]);
        if (!foot.converged && !foot.beyond) ++failed;
    };
    if (options.surface == ErrorSurface::Samples) {
        find_nearest_points(to, places, found, context);
        if (options.attributes) all.taken = places;
        all.cover = cover;
        return all;
    }
    to.finder.find(places, found, context);
    all.failed = failed;
    all.cover = cover;
    if (options.attributes) all.taken = places;  // of which the worst are moved
    confirm_worst(places, distances, to.finder, are_points ? nullptr : &from.finder, from.points,
                  from.tree, context);
    if (!known.empty() && searches(options))
        add_farthest_points(from.lone_points, to.finder, std::move(known), all.measured, context);
    else if (searches(options) && !are_points)
        add_places_around_farthest(from.finder, from.lone_points, to.finder, all.measured, context);
    return all;
}

DirectedError measure_direction(const Surface& from, const Surface& to, ErrorSamples&& samples,
                                const ErrorFrame& frame, const SurfaceErrorOptions& options,
                                const RunContext& context) {
    const bool are_points = at_points(from, is_finer(from, to), options);
    std::vector<float> areas = std::move(samples.areas);
    const std::size_t n = areas.size();
    MeasuredSamples all =
        measure_samples(from, to, std::move(samples), are_points, options, context);
    context.checkpoint(0.8);

    auto& [places, distances] = all.measured;
    auto lengths = made_in_blocks<std::vector<float>>(distances.size(), context);
    for_blocks_in_order(lengths.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            lengths[i] = static_cast<float>(distances[i] / frame.scale);
    });
    areas.resize(lengths.size());  // what was added stands for none
    const Vec3f farthest =
        places[static_cast<std::size_t>(std::ranges::max_element(lengths) - lengths.begin())];
    DirectedError error = summarize_distances(lengths, areas, options.histogram_bins, context);
    for (auto* const values : {&lengths, &areas}) values->resize(n);
    places.resize(n);
    error.max_at = frame.center + farthest.cast<double>() / frame.scale;
    error.samples = n;
    error.cover_radius = all.cover / frame.scale;
    error.not_converged = static_cast<double>(all.failed) / static_cast<double>(n);
    if (options.attributes)
        error.attributes = attribute_errors(from.attributed(), to.attributed(), all.taken, all.feet,
                                            areas, options.k, context);
    if (options.keep_samples) {
        error.distances = std::move(lengths);
        error.positions = std::move(places);
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

struct SurfaceErrorMeter::State {
    SurfaceErrorOptions options;
    FootFinder::Options finding;
    BoxedCloud reference;
    ErrorFrame frame;
    Surface surface;

    State(const PointCloud& cloud, const SurfaceErrorOptions& options_, const RunContext& context)
        : options(options_),
          finding{.k = options.k,
                  .degree = options.surface == ErrorSurface::Quadratic ? 2U : 1U,
                  .max_iterations = options.max_iterations,
                  .tolerance = options.tolerance},
          reference(cloud, "reference"),
          frame(reference),
          surface(cloud, frame, leaves_of(cloud, options), finding, context) {}

    /// Places on the reference. Those that are asked for twice are kept, for each seed the last.
    ErrorSamples samples_of_reference(bool finer, const SurfaceErrorOptions& as,
                                      const RunContext& context) {
        const auto known = std::ranges::find(drawn, as.seed, &Drawn::seed);
        Drawn& one = known != drawn.end() ? *known : drawn.emplace_back(Drawn{.seed = as.seed});
        const bool again = one.finer == finer && one.count == as.samples;
        if (again && one.samples.size() > 0) return one.samples;
        one = {.seed = as.seed, .count = as.samples, .finer = finer};
        ErrorSamples samples = take_samples(surface, finer, as, context);
        if (again) one.samples = samples;
        return samples;
    }

private:
    struct Drawn {
        std::uint64_t seed = 0;
        std::optional<std::uint64_t> count{};  ///< asked for; none: nothing yet
        bool finer = false;
        ErrorSamples samples{};
    };
    std::vector<Drawn> drawn;
};

SurfaceErrorMeter::SurfaceErrorMeter(const PointCloud& reference,
                                     const SurfaceErrorOptions& options,
                                     const RunContext& context) {
    validate(options);
    context.throw_if_stopped();
    state_ = std::make_unique<State>(reference, options, context);
}

SurfaceErrorMeter::~SurfaceErrorMeter() = default;

SurfaceError SurfaceErrorMeter::measure(const PointCloud& candidate, const RunContext& context) {
    return measure(candidate, state_->options.samples, state_->options.seed, context);
}

SurfaceError SurfaceErrorMeter::measure(const PointCloud& candidate, std::uint64_t samples,
                                        std::uint64_t seed, const RunContext& context) {
    SurfaceErrorOptions options = state_->options;
    options.samples = samples;
    options.seed = seed;
    validate(options);
    const BoxedCloud& reference = state_->reference;
    const ErrorFrame& frame = state_->frame;
    const Surface& S = state_->surface;
    const BoxedCloud boxed(candidate, "candidate");
    frame.require_reach(boxed);
    context.throw_if_stopped();
    if (!options.attributes)
        if (auto far = measure_far(reference, boxed, options, context)) return std::move(*far);
    const Surface S_prime(candidate, frame, leaves_of(candidate, options), state_->finding,
                          context);
    context.checkpoint(0.1);
    SurfaceError error;
    error.diagonal = reference.box.diagonal();
    error.candidate_diagonal = boxed.box.diagonal();
    ErrorSamples places =
        state_->samples_of_reference(is_finer(S, S_prime), options, context.part(0.1, 0.3));
    error.forward =
        measure_direction(S, S_prime, std::move(places), frame, options, context.part(0.3, 0.55));
    places = take_samples(S_prime, is_finer(S_prime, S), options, context.part(0.55, 0.8));
    error.backward =
        measure_direction(S_prime, S, std::move(places), frame, options, context.part(0.8, 1.0));
    for (DirectedError* const direction : {&error.forward, &error.backward}) {
        for (Vec3f& p : direction->positions) p = frame.out_of(p, S.cloud);
    }
    return error;
}

SurfaceError measure_error(const PointCloud& reference, const PointCloud& candidate,
                           const SurfaceErrorOptions& options, const RunContext& context) {
    validate(options);
    check_positions(candidate, "candidate");
    SurfaceErrorMeter meter(reference, options, context);
    context.checkpoint(0.1);
    return meter.measure(candidate, context.part(0.1, 1.0));
}

}  // namespace stipple
