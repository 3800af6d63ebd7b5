#include "even_thinning.hpp"
#include "stipple/surface_error.hpp"

#include <algorithm>
#include <optional>

namespace stipple {

SurfaceErrorOptions quick_options(std::uint64_t reference_points, std::uint64_t candidate_points) {
    constexpr std::uint64_t kLeast = 300, kMost = 2'000, kPart = 400;
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
    const std::optional<PointCloud> thinned = thinned_for(candidate, reference, context);
    if (!thinned) return measure_error(reference, candidate, options, context);
    SurfaceError error = measure_error(*thinned, candidate, options, context);
    error.diagonal = bounds(reference).diagonal();
    return error;
}

}  // namespace stipple
