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
    Index begin = 0, end = 0;        ///< its points among the members
    Vec3f centroid = Vec3f::Zero();  ///< scaled
    double variation = 0;            ///< Eq. 5; measured only where it is bounded
    bool is_bent = false;  ///< whether a point more would have put it above the bound on that

    Index size() const noexcept { return end - begin; }
};

/// Regions in the order in which they were grown; together they have every point once.
struct Regions {
    float scale = 1;  ///< a power of two, by which coordinates are multiplied so that their squares
                      ///< are no trouble
    std::vector<Index> members;
    std::vector<Region> regions;
};

/// Grows regions until every point is in one.
///
/// A region takes the free points nearest to its seed, at most n_max of them, as far as 1.3 R,
/// where R is the radius about the seed that holds n_max points, free or not: what lies beyond is
/// the neighbourhood of others. R is at most twice what the last region makes one expect; where
/// n_max points are not to be found so near, as about an outlier, one expects a quarter more from
/// then on.
///
/// The next seed is the free point within 1.85 R whose squared distance is nearest to that of 1.75
/// R, where the next region fits beside this one; where there is none, the first free point. The
/// first seed is chosen by `seed`. Among equal distances the smaller number counts as nearer.
///
/// Under a bound on the variation, n_max starts at twice the last region's size, 8 at least, and is
/// doubled while all points taken are within the bound; the region ends with the last of them at
/// which the bound holds, and the next seed is sought as if R were how far that one is.
///
/// @param points  finite, at least one.
Regions grow_regions(std::span<const Vec3f> points, const RegionBounds& bounds, std::uint64_t seed,
                     const RunContext& context);

}  // namespace stipple
