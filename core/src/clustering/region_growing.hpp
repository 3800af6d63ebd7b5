#pragma once

#include "clustering/point_blocks.hpp"
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
    double variation = 0;            ///< Eq. 5; measured only where it is bounded and ended nothing
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

/// Points in blocks of the size that suits regions within these bounds.
PointBlocks blocks_for_regions(std::span<const Vec3f> points, const RegionBounds& bounds,
                               const RunContext& context);

/// Grows regions of the free points until every point is in one.
///
/// A region takes the free points nearest to its seed, at most n_max of them, as far as 1.3 R,
/// where R is the radius about the seed that holds n_max points, free or not: what lies beyond is
/// the neighbourhood of others. R is at most twice what the last region makes one expect; where
/// n_max points are not to be found so near, as about an outlier, one expects a quarter more from
/// then on.
///
/// The next seed is the free point within 1.85 R whose squared distance is nearest to that of 1.75
/// R, where the next region fits beside this one; where there is none, the first free point in the
/// order of the blocks. `seed` chooses the first. Among equal distances the smaller number counts
/// as nearer.
///
/// Under a bound on the variation, n_max starts at 8 and is made four times as much while all
/// points taken are within the bound. Else they are divided into 16 rings of equal area, and the
/// region ends with the last ring at which the bound holds, or in the first ring with the last
/// point at which it does; the next seed is sought as if R were how far the last point taken is,
/// and n_max is twice as many points as were taken, 8 at least.
///
/// Where 4,096 regions or more are to be expected, they are grown in parts of the blocks first, one
/// to 2,048 regions and 16 at most, on the threads of `context`: there a seed about which one would
/// have to look beyond the part is left for later, with all of its block. What is left between the
/// parts comes last, as one.
Regions grow_regions(PointBlocks& blocks, const RegionBounds& bounds, std::uint64_t seed,
                     const RunContext& context);

/// How many regions there would be if each were as large as one that grows from a random seed where
/// all points are free, by the mean of some. Takes no point; none must be taken.
double estimated_regions(PointBlocks& blocks, const RegionBounds& bounds,
                         const RunContext& context);

}  // namespace stipple
