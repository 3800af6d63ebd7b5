#include "stipple/mls.hpp"

#include "analysis/mls_fit.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "neighbors/point_tree.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>

// Follows: Levin 2003 and Alexa et al. 2003 (the projection), Pauly, Gross, Kobbelt 2002, §2.2 (the
// adaptive h). The fits are in mls_fit.cpp.

namespace stipple {

namespace {

constexpr unsigned kMaxNeighbors = 64;
constexpr double kReach = 3.0;  // in h: the weight there is e^-9

void check(std::span<const Vec3f> points, const MlsOptions& options) {
    if (points.empty()) refuse("points 0: expected at least 1");
    require(options.degree <= 4, "degree", options.degree, "0..4");
    require(options.k >= 6 && options.k <= kMaxNeighbors, "k", options.k, "6..64");
    if (options.h)
        require(*options.h > 0 && std::isfinite(*options.h), "h", *options.h,
                "a finite length above 0");
    if (options.max_iterations == 0) refuse("max_iterations 0: expected at least 1");
    require(options.tolerance > 0 && options.tolerance < 1, "tolerance", options.tolerance,
            "a fraction of h, above 0 and below 1");
}

MlsStatus status_of(MlsPlane::Kind kind) noexcept {
    switch (kind) {
        case MlsPlane::Kind::Minimum:
            return MlsStatus::Converged;
        case MlsPlane::Kind::Weighted:
            return MlsStatus::NotConverged;
        default:
            return MlsStatus::Degenerate;
    }
}

/// What one thread needs for its projections.
struct Scratch {
    MlsNeighborhood around;
    std::array<Neighbor, kMaxNeighbors> nearest{};
    std::vector<Neighbor> within;
};

}  // namespace

struct MlsSurface::Implementation {
    MlsOptions options;
    std::vector<Vec3f> points;
    PointTree tree;

    /// Gathers the neighbours of r, relative to it. @return h; 0 where no weight reaches r.
    double gather(const Vec3d& r, Scratch& scratch) const {
        const Vec3f at = r.cast<float>();
        std::span<const Neighbor> found;
        if (options.h) {
            scratch.within.clear();
            find_within(tree, at, static_cast<float>(kReach * kReach * *options.h * *options.h),
                        scratch.within);
            found = scratch.within;
        } else {
            found = find_nearest(tree, at, std::span(scratch.nearest).first(options.k));
        }
        MlsNeighborhood& around = scratch.around;
        around.resize(found.size());
        double farthest_sq = 0;
        for (std::size_t i = 0; i < found.size(); ++i) {
            const Vec3d d = points[found[i].index].cast<double>() - r;
            around.x[i] = d.x();
            around.y[i] = d.y();
            around.z[i] = d.z();
            farthest_sq = std::max(farthest_sq, d.squaredNorm());
        }
        if (options.h) return found.empty() ? 0 : *options.h;
        // Where all neighbours lie at r, any scale gives them the same weight.
        return farthest_sq > 0 ? std::sqrt(farthest_sq) / kReach : 1.0;
    }

    /// Psi(P, r), and the h that it used.
    MlsProjection project_once(const Vec3d& r, Scratch& scratch, double& h) const {
        h = gather(r, scratch);
        if (h == 0) return {r, Vec3d::UnitZ(), MlsStatus::TooFar};
        const MlsPlane plane =
            fit_plane(scratch.around, h, options.max_iterations, options.tolerance);
        const MlsStatus status = status_of(plane.kind);
        if (status == MlsStatus::Degenerate) return {r + plane.q, plane.n, status};
        const MlsHeight g = fit_polynomial(scratch.around, plane.n, plane.q, h, options.degree);
        return {r + plane.q + g.height * plane.n, g.normal, status};
    }

    MlsProjection project(const Vec3d& r, Scratch& scratch) const {
        double h = 0;
        MlsProjection projection = project_once(r, scratch, h);
        if (!options.fixed_point) return projection;
        for (unsigned i = 1; i < options.max_iterations; ++i) {
            const Vec3d before = projection.point;
            projection = project_once(before, scratch, h);
            if (!((projection.point - before).norm() > options.tolerance * h)) return projection;
        }
        if (projection.status == MlsStatus::Converged) projection.status = MlsStatus::NotConverged;
        return projection;
    }
};

MlsSurface::MlsSurface(std::span<const Vec3f> points, const MlsOptions& options,
                       const RunContext& context) {
    check(points, options);
    std::vector<Vec3f> copied;
    reserve_in_blocks(copied, points.size(), context);
    for_blocks_in_order(points.size(), context, [&](std::size_t begin, std::size_t end) {
        const auto block = points.subspan(begin, end - begin);
        copied.insert(copied.end(), block.begin(), block.end());
    });
    implementation_ = std::make_unique<const Implementation>(Implementation{
        options, std::move(copied), PointTree(points, PointTree::Leaves::Compact, context)});
}
MlsSurface::~MlsSurface() = default;
MlsSurface::MlsSurface(MlsSurface&&) noexcept = default;
MlsSurface& MlsSurface::operator=(MlsSurface&&) noexcept = default;

MlsProjection MlsSurface::project(const Vec3d& r) const {
    Scratch scratch;
    return implementation_->project(r, scratch);
}

std::vector<MlsProjection> MlsSurface::project(std::span<const Vec3f> points,
                                               const RunContext& context) const {
    constexpr std::size_t kBlock = 1024;
    auto projections = made_in_blocks<std::vector<MlsProjection>>(points.size(), context);
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        Scratch scratch;
        for (std::size_t i = begin; i < end; ++i)
            projections[i] = implementation_->project(points[i].cast<double>(), scratch);
    });
    return projections;
}

}  // namespace stipple
