#pragma once

#include "neighbors/point_tree.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstddef>
#include <functional>
#include <span>

namespace stipple {

/// Where a query meets a surface: q' of §4.
struct Foot {
    Vec3d point = Vec3d::Zero();
    Vec3d normal = Vec3d::UnitZ();  ///< of the surface there; the sign is any
    double distance = 0;            ///< d(q, S')
    double to_sample = 0;           ///< from q to the nearest sample
    double radius = 0;              ///< of the neighbourhood there
    double h = 0;                   ///< scale of the weights there: r / 3, less on a line
    double off_center = 0;          ///< from there to the mean of its neighbourhood, over h
    double emptiness = 0;           ///< from there to the nearest sample, over 3 h
    double roundness = 0;           ///< λ0 / λ1 there, in 0..1; less on a line
    double line = 0;                ///< how far it is the foot on a line, not on a plane: 0..1
    bool converged = false;
    bool beyond = false;  ///< where the surface has no samples: `distance` is how far they are

    /// Whether the way to the surface is 0 from the point, and samples are beside it: where there
    /// are none planes have feet too.
    bool is_fixed() const noexcept { return converged && !beyond && emptiness <= 0.5; }
    /// Whether the point is also one of the surface: within a knot of samples, which has no normal,
    /// there are fixed points that no surface goes through.
    bool on_surface() const noexcept { return is_fixed() && roundness <= 0.5; }
    /// Whether it is hardly amid its neighbours, as none at a border is.
    bool is_one_sided() const noexcept { return off_center > 0.4; }
};

/// Finds the feet of many queries on the MLS surface of some points, with k nearest neighbours and
/// h = r / 3.
///
/// With a linear basis the surface is { x | n(x) . (x - a(x)) = 0 }, with a the weighted mean and n
/// the normal of the weighted least squares plane of the neighbours of x. A foot is a fixed point
/// of x <- q - (n . (q - a)) n. Each query starts at q; where that foot is farther than h / 4 or
/// none is found, at the sample nearest to q as well, and the nearer foot counts. The surface ends
/// where its samples end: a query farther from all samples than a neighbourhood reaches starts from
/// the nearest one only, and no foot is nearer than that sample less the radius of its
/// neighbourhood (of about 20 points when k is less).
class FootFinder {
public:
    struct Options {
        unsigned k = 20;
        unsigned degree = 1;  ///< of the basis: 1 or 2
        unsigned max_iterations = 30;
        double tolerance = 1e-3;  ///< a foot moves by less than this part of h
        double sure_part = 0;  ///< a way also ends where its steps will change the distance by less
                               ///< than this part of it: for who asks for distances, not for feet
        bool across_sample = false;  ///< what counts where no way ends: no more than the way to the
                                     ///< nearest sample, and from there across its plane; else no
                                     ///< more than that to the sample, which is too little in the
                                     ///< mean, yet no single walk makes the largest distance
    };

    /// @param points  at least one; must outlive the finder, like their tree.
    FootFinder(std::span<const Vec3f> points, const PointTree& tree, const Options& options);

    /// Calls found(i, foot) once for each query, from several threads. Quicker when queries that
    /// follow each other lie near each other.
    void find(std::span<const Vec3f> queries,
              const std::function<void(std::size_t, const Foot&)>& found,
              const RunContext& context) const;

    /// How far a place lies beyond where the surface ends, as seen along the normal of its foot:
    /// planes go on there.
    struct Overhang {
        float way = 0;    ///< to the hull of the samples nearest to it, at least; 0 within
        float reach = 0;  ///< no sample farther from the place changes that
    };
    static constexpr std::size_t kMostAround = 96;
    /// @param count  of those samples, up to `kMostAround`. Of fewer than 20 all may lie on one
    /// side
    ///               by chance; in noise and where the density is uneven more do.
    Overhang overhang_of(const Vec3f& place, const Foot& foot, std::size_t count = 20) const;

    std::span<const Vec3f> points() const noexcept { return points_; }

    /// The sample nearest to a place.
    Vec3f nearest_sample(const Vec3f& place) const;

private:
    std::span<const Vec3f> points_;
    const PointTree& tree_;
    Options options_;
};

}  // namespace stipple
