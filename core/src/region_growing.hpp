#pragma once

#include "stipple/clusters.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace stipple {

/// The bounds of a region (§3.1).
struct RegionBounds {
    std::uint64_t max_size = 1;  ///< n_max >= 1
    double max_variation =
        std::numeric_limits<double>::infinity();  ///< sigma_max; infinite: no bound
};

/// A region that has been grown.
struct Region {
    Index begin = 0, end = 0;  ///< its points among the members
    Vec3d centroid = Vec3d::Zero();
    double variation = 0;  ///< Eq. 5; measured only where it is bounded

    Index size() const noexcept { return end - begin; }
};

/// Regions in the order in which they were grown; together they have every point once.
struct Regions {
    std::vector<Index> members;
    std::vector<Region> regions;
};

/// Grows regions until every point is in one.
///
/// A region takes the free points nearest to its seed, at most n_max of them, as far as 1.3 times
/// the radius R about the seed that holds n_max points, free or not: those beyond are neighbours of
/// other regions. R is at most twice that of the last region that had n_max points within it, and a
/// quarter more for each since, so that an outlier does not reach for the surface. A bound on the
/// variation ends a region at the last size at which it holds, tried in steps of doubled size.
///
/// The next seed is the free point within 2 R whose distance is nearest to 1.8 R, where the next
/// region fits beside this one; where there is none, the first free point. The first seed is chosen
/// by `seed`. Among equal distances the smaller number counts as nearer.
///
/// @param points  finite, at least one.
Regions grow_regions(std::span<const Vec3f> points, const RegionBounds& bounds, std::uint64_t seed,
                     const RunContext& context);

}  // namespace stipple
