#include "stipple/local_analysis.hpp"

#include "covariance_kernels.hpp"
#include "leaf_query.hpp"
#include "parallel_for.hpp"
#include "point_tree.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

// Follows: Pauly, Gross and Kobbelt 2002 (§2.1). The size of a neighbourhood is chosen as Mitra,
// Nguyen and Guibas 2004 propose: where the errors of the normal that come from noise, which
// shrink as it grows, and from curvature, which grow, add up to the least. They take the level of
// the noise as given and model the curvature; here both are read from the distances of the points
// to the planes through neighbourhoods of several sizes.

namespace stipple {

namespace {

constexpr std::size_t kWidth = PointTree::kWidth;
constexpr std::size_t kLeavesPerBlock = 128;
constexpr std::array<unsigned, 7> kScales = {8, 12, 16, 24, 32, 48, 64};

/// What one neighbourhood tells of its point.
struct Shape {
    Vec3d normal;
    double low, middle, high;  ///< eigenvalues of the covariance
    unsigned k;
    double radius_sq;

    double freedom() const noexcept { return std::max(1.0, k - 2.0); }  ///< k + 1 points, a plane
    /// Mean squares of the distances from the plane and of the width of the neighbourhood where it
    /// is least.
    double residual_sq() const noexcept { return low / freedom(); }
    double width_sq() const noexcept { return middle / (k + 1.0); }
};

/// The shapes of the neighbourhoods of the points of one leaf, of several sizes.
class LeafShapes {
public:
    LeafShapes(const PointTree& tree, std::span<const Vec3f> points, std::vector<unsigned> sizes)
        : tree_(tree),
          sizes_(std::move(sizes)),
          query_(tree, points, sizes_.back()),
          slots_(query_.most_chosen()),
          distances_sq_(query_.most_chosen()),
          problems_(sizes_.size()),
          radii_sq_(sizes_.size()),
          kernels_(covariance_kernels()) {}

    std::size_t scale_count() const noexcept { return sizes_.size(); }

    void run(std::size_t leaf) {
        if (tree_.points_in(leaf) < kWidth) std::ranges::fill(problems_, EigenProblems{});
        query_.run(leaf, [&](std::size_t lane, const Candidates& near, const Chosen& chosen) {
            measure(tree_.leaf(leaf).position(lane), lane, near, chosen);
        });
        for (EigenProblems& problems : problems_) kernels_.solve(problems);
    }

    Shape shape(std::size_t scale, std::size_t lane) const noexcept {
        const EigenProblems& p = problems_[scale];
        return {{p.x[lane], p.y[lane], p.z[lane]},
                std::max(0.0, p.low[lane]),
                std::max(0.0, p.middle[lane]),
                std::max(0.0, p.high[lane]),
                sizes_[scale],
                radii_sq_[scale][lane]};
    }

private:
    void measure(const Vec3f& q, std::size_t lane, const Candidates& near, const Chosen& chosen) {
        // In order of distance, so that each neighbourhood continues the one before, and the sums
        // do not depend on how the neighbours were found.
        for (std::uint32_t i = 0; i < chosen.count; ++i) {
            slots_[chosen.rank[i]] = chosen.slot[i];
            distances_sq_[chosen.rank[i]] = chosen.distance_sq[i];
        }
        Moments moments;
        unsigned done = 0;
        for (std::size_t scale = 0; scale < sizes_.size(); ++scale) {
            const unsigned k = sizes_[scale];
            kernels_.add_moments(near, slots_.data() + done, k - done, q.data(), moments);
            done = k;
            set_covariance(problems_[scale], lane, moments, k);
            radii_sq_[scale][lane] = static_cast<double>(distances_sq_[k - 1]);
        }
    }

    /// Of k neighbours and the point itself, which is the reference: around their centroid.
    static void set_covariance(EigenProblems& p, std::size_t lane, const Moments& m,
                               unsigned k) noexcept {
        const double by = 1.0 / (static_cast<double>(k) + 1.0);
        const double x = m.sum[0], y = m.sum[1], z = m.sum[2];
        p.xx[lane] = m.squares[0] - x * x * by;
        p.yy[lane] = m.squares[1] - y * y * by;
        p.zz[lane] = m.squares[2] - z * z * by;
        p.xy[lane] = m.products[0] - x * y * by;
        p.yz[lane] = m.products[1] - y * z * by;
        p.zx[lane] = m.products[2] - z * x * by;
    }

    const PointTree& tree_;
    std::vector<unsigned> sizes_;
    LeafQuery query_;
    std::vector<std::uint32_t> slots_;
    std::vector<float> distances_sq_;
    std::vector<EigenProblems> problems_;               ///< of each size
    std::vector<std::array<double, kWidth>> radii_sq_;  ///< beside them
    const CovarianceKernels& kernels_;
};

/// The neighbourhood with the least error of the normal, the larger one in a tie.
Shape most_trusted(const LeafShapes& shapes, std::size_t lane) noexcept {
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
    if (options.k != 0 && (options.k < 3 || options.k > 64))
        throw Error(ErrorCode::InvalidArgument,
                    "k " + std::to_string(options.k) +
                        ": expected 3..64 neighbours, or 0 to choose for each point");
}

/// The sizes of neighbourhoods to look at, where there are `others` to choose from.
std::vector<unsigned> sizes_for(const LocalAnalysisOptions& options, std::size_t others) {
    std::vector<unsigned> sizes = {options.k};
    if (options.k == 0) sizes.assign(kScales.begin(), kScales.end());
    for (unsigned& k : sizes) k = static_cast<unsigned>(std::min<std::size_t>(k, others));
    sizes.erase(std::unique(sizes.begin(), sizes.end()), sizes.end());
    return sizes;
}

LocalAnalysis room_for(std::size_t n, const LocalAnalysisOptions& options) {
    LocalAnalysis result;  // as of a point that is alone
    if (options.normals) result.normals.assign(n, Vec3f::UnitZ());
    if (options.variation) result.variation.resize(n);
    if (options.density) result.density.resize(n);
    if (options.anisotropy) result.anisotropy.resize(n);
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
    LocalAnalysis result = room_for(points.size(), options);
    if (points.size() < 2) return result;
    const std::vector<unsigned> sizes = sizes_for(options, points.size() - 1);
    const PointTree tree(points, context);
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
