#include "error/far_clouds.hpp"

#include "base/distance_statistics.hpp"
#include "base/parallel_for.hpp"

#include <algorithm>
#include <utility>
#include <vector>

namespace stipple {

namespace {

double distance_to(const Vec3d& place, const PointCloud& cloud, std::size_t i) {
    return (cloud.origin + cloud.positions[i].cast<double>() - place).norm();
}

bool is_point_for(const BoxedCloud& boxed, const PointCloud& other, const RunContext& context) {
    constexpr double kFar = 100;
    constexpr std::size_t kFew = 64;  // take no time
    if (boxed.cloud.size() < kFew) return false;
    const Vec3d middle = boxed.middle();
    const double near = kFar * boxed.box.diagonal();
    for (std::size_t i = 0; i < other.size(); ++i) {
        constexpr std::size_t kBetweenChecks = 65'536;
        if (i % kBetweenChecks == 0) context.throw_if_stopped();
        if (distance_to(middle, other, i) <= near) return false;
    }
    return true;
}

DirectedError of_distances(std::vector<float>&& distances, std::vector<Vec3f>&& positions,
                           const SurfaceErrorOptions& options, const RunContext& context) {
    const std::vector<float> areas(distances.size(), 1.0F);
    DirectedError error = summarize_distances(distances, areas, options.histogram_bins, context);
    error.samples = distances.size();
    if (options.keep_samples) {
        error.distances = std::move(distances);
        error.positions = std::move(positions);
    }
    return error;
}

}  // namespace

std::optional<SurfaceError> measure_far(const BoxedCloud& reference, const BoxedCloud& candidate,
                                        const SurfaceErrorOptions& options,
                                        const RunContext& context) {
    const bool from_reference = is_point_for(candidate, reference.cloud, context);
    if (!from_reference && !is_point_for(reference, candidate.cloud, context)) return std::nullopt;
    const PointCloud& cloud = (from_reference ? reference : candidate).cloud;
    const Vec3d point = (from_reference ? candidate : reference).middle();
    const Vec3d& origin = reference.cloud.origin;
    std::vector<float> distances(cloud.size());
    std::vector<Vec3f> positions(options.keep_samples ? cloud.size() : 0);
    for_blocks_in_order(cloud.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            distances[i] = static_cast<float>(distance_to(point, cloud, i));
            if (options.keep_samples)
                positions[i] =
                    (cloud.origin - origin + cloud.positions[i].cast<double>()).cast<float>();
        }
    });
    const float least = *std::ranges::min_element(distances);
    SurfaceError error;
    error.diagonal = reference.box.diagonal();
    error.candidate_diagonal = candidate.box.diagonal();
    DirectedError& to_point = from_reference ? error.forward : error.backward;
    DirectedError& from_point = from_reference ? error.backward : error.forward;
    to_point = of_distances(std::move(distances), std::move(positions), options, context);
    from_point = of_distances({least}, {(point - origin).cast<float>()}, options, context);
    return error;
}

}  // namespace stipple
