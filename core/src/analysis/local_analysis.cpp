#include "stipple/local_analysis.hpp"

#include "analysis/leaf_shapes.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "neighbors/point_tree.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

// Follows: Pauly, Gross and Kobbelt 2002 (§2.1). The size of a neighbourhood is chosen as Mitra,
// Nguyen and Guibas 2004 propose: where the errors of the normal that come from noise, which
// shrink as it grows, and from curvature, which grow, add up to the least. They take the level of
// the noise as given and model the curvature; here both are read from the distances of the points
// to the planes through neighbourhoods of several sizes.

namespace stipple {

namespace {

constexpr std::size_t kLeavesPerBlock = 128;

/// The neighbourhood with the least error of the normal, the larger one in a tie.
Shape most_trusted(const LeafShapes& shapes, std::size_t lane) noexcept {
    if (shapes.scale_count() == 1) return shapes.shape(0, lane);
    // No larger than the least residual, allowing for its being small by chance.
    double noise_sq = std::numeric_limits<double>::max();
    for (std::size_t scale = 0; scale < shapes.scale_count(); ++scale) {
        const Shape s = shapes.shape(scale, lane);
        constexpr double kDeviations = 2.0;
        const double chance = 1.0 + kDeviations * std::sqrt(2.0 / s.freedom());
        noise_sq = std::min(noise_sq, s.residual_sq() * chance);
    }
    Shape best = shapes.shape(0, lane);
    double least = std::numeric_limits<double>::max();
    for (std::size_t scale = 0; scale < shapes.scale_count(); ++scale) {
        const Shape s = shapes.shape(scale, lane);
        // An even bend lifts all sides alike: only a part of it leans the plane.
        constexpr double kLeaning = 0.1;
        const double by_curvature = kLeaning * std::max(0.0, s.residual_sq() - noise_sq);
        const double error_sq = noise_sq / s.k + by_curvature;  // times the width
        if (!(error_sq <= least * s.width_sq())) continue;
        best = s;
        least = s.width_sq() > 0 ? error_sq / s.width_sq() : least;
    }
    return best;
}

double density_of(const Shape& shape) noexcept {
    constexpr double kMost = std::numeric_limits<float>::max();
    const double k = shape.k;
    return k < kMost * shape.radius_sq ? k / shape.radius_sq : kMost;
}

void check(const LocalAnalysisOptions& options) {
    require(options.k == 0 || (options.k >= 3 && options.k <= 64), "k", options.k,
            "3..64 neighbours, or 0 to choose for each point");
}

LocalAnalysis room_for(std::size_t n, const LocalAnalysisOptions& options,
                       const RunContext& context) {
    LocalAnalysis result;  // as of a point that is alone
    if (options.normals) {
        result.normals.reserve(n);
        for_blocks_in_order(n, context, [&](std::size_t, std::size_t end) {
            result.normals.resize(end, Vec3f::UnitZ());
        });
    }
    if (options.variation) resize_in_blocks(result.variation, n, context);
    if (options.density) resize_in_blocks(result.density, n, context);
    if (options.anisotropy) resize_in_blocks(result.anisotropy, n, context);
    return result;
}

}  // namespace

double surface_variation(const Vec3d& eigenvalues) noexcept {
    const double sum = eigenvalues.sum();
    return sum > 0 ? std::clamp(eigenvalues[0] / sum, 0.0, 1.0 / 3.0) : 0.0;
}

LocalAnalysis analyze_locally(std::span<const Vec3f> points, const LocalAnalysisOptions& options,
                              const RunContext& context) {
    check(options);
    LocalAnalysis result = room_for(points.size(), options, context);
    if (points.size() < 2) return result;
    const std::vector<unsigned> sizes =
        sizes_up_to(points.size() - 1, options.k == 0 ? std::span<const unsigned>(kScales)
                                                      : std::span<const unsigned>(&options.k, 1));
    const PointTree tree(points, PointTree::Leaves::Quick, context);
    const auto write = [&](Index i, const Shape& shape) {
        if (options.normals) result.normals[i] = shape.normal.cast<float>();
        if (options.variation)
            result.variation[i] =
                static_cast<float>(surface_variation({shape.low, shape.middle, shape.high}));
        if (options.density) result.density[i] = static_cast<float>(density_of(shape));
        if (options.anisotropy)
            result.anisotropy[i] =
                shape.high > 0 ? static_cast<float>((shape.high - shape.middle) / shape.high) : 0;
    };
    parallel_for_blocks(tree.leaf_count(), kLeavesPerBlock, context,
                        [&](std::size_t begin, std::size_t end) {
                            LeafShapes shapes(tree, points, sizes);
                            for (std::size_t l = begin; l < end; ++l) {
                                shapes.run(l);
                                for (std::size_t lane = 0; lane < tree.points_in(l); ++lane)
                                    write(tree.leaf(l).index[lane], most_trusted(shapes, lane));
                            }
                        });
    return result;
}

}  // namespace stipple
