#pragma once

#include "analysis/covariance_kernels.hpp"
#include "neighbors/leaf_query.hpp"
#include "neighbors/point_tree.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace stipple {

/// Sizes of neighbourhoods for what looks at several.
constexpr std::array<unsigned, 7> kScales = {8, 12, 16, 24, 32, 48, 64};

/// The sizes that there can be where a point has so many others: each once, ascending.
inline std::vector<unsigned> sizes_up_to(std::size_t others, std::span<const unsigned> wanted) {
    std::vector<unsigned> sizes(wanted.begin(), wanted.end());
    for (unsigned& k : sizes) k = static_cast<unsigned>(std::min<std::size_t>(k, others));
    sizes.erase(std::unique(sizes.begin(), sizes.end()), sizes.end());
    return sizes;
}

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
        if (tree_.points_in(leaf) < PointTree::kWidth)
            std::ranges::fill(problems_, EigenProblems{});
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
    std::vector<EigenProblems> problems_;                          ///< of each size
    std::vector<std::array<double, PointTree::kWidth>> radii_sq_;  ///< beside them
    const CovarianceKernels& kernels_;
};

}  // namespace stipple
