#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <compare>
#include <memory>
#include <span>
#include <vector>

namespace stipple {

/// The neighbours of many points, flat: those of point i are `indices[offsets[i]] ..
/// indices[offsets[i + 1]]`, nearest first; ties are broken by the smaller index.
struct NeighborLists {
    std::vector<Index> indices;
    std::vector<float> distances_sq;     ///< for each index, in squared input units
    std::vector<std::uint64_t> offsets;  ///< N + 1

    std::size_t size() const noexcept { return offsets.empty() ? 0 : offsets.size() - 1; }
    std::span<const Index> of(std::size_t i) const noexcept {
        return {indices.data() + offsets[i], indices.data() + offsets[i + 1]};
    }
};

/// A point found from some position. Ordered by distance, then index.
struct Neighbor {
    float distance_sq;  ///< squared input units
    Index index;        ///< of the point

    friend auto operator<=>(const Neighbor&, const Neighbor&) = default;
};

/// Finds the points near any position. Holds a copy of the positions: 20 bytes per point.
///
/// All functions are exact in the squared distance computed in floats, dx² + dy² + dz² summed in
/// that order. They allocate nothing and may be called by many threads at once.
class NeighborSearch {
public:
    /// Positions must be finite (`clean`). O(N log N), parallel; about 30 more bytes per point
    /// during construction.
    explicit NeighborSearch(std::span<const Vec3f> points, const RunContext& context = {});
    ~NeighborSearch();
    NeighborSearch(NeighborSearch&&) noexcept;
    NeighborSearch& operator=(NeighborSearch&&) noexcept;

    /// The number of points.
    std::size_t size() const noexcept;

    /// The nearest points to `q` (finite), as many as fit in `room` or exist; a point at `q` is
    /// among them, at distance 0. Nearest first; ties are broken by the smaller index. Fastest for
    /// up to 64.
    /// @return the filled beginning of `room`.
    ///
    /// Expected O(k + log N).
    std::span<Neighbor> nearest(const Vec3f& q, std::span<Neighbor> room) const noexcept;

    /// Clears `found` and fills it with all points whose squared distance to `q` (finite) is at
    /// most `radius`², in an order that depends only on the points. Finds nothing for a radius that
    /// is negative or NaN.
    void within(const Vec3f& q, float radius, std::vector<Neighbor>& found) const;

private:
    std::unique_ptr<const class PointTree> tree_;
};

/// The k nearest neighbours N_p of every point (§2), excluding the point itself; fewer if there are
/// fewer points.
///
/// Exact: ordered by (squared distance in float, index). Positions must be finite (`clean`).
/// @param k  >= 1.
/// @throws Error(InvalidArgument) for k = 0.
///
/// Expected O(N k) for points on surfaces; 8 k + 8 bytes per point, and about 50 more while it
/// runs.
NeighborLists k_nearest_neighbors(std::span<const Vec3f> points, unsigned k,
                                  const RunContext& context = {});

/// All points within `radius` (input units, inclusive) of every point, excluding the point itself.
/// @throws Error(InvalidArgument) for a radius that is not finite and positive; Error(TooLarge)
/// above 2^32 pairs.
NeighborLists radius_neighbors(std::span<const Vec3f> points, float radius,
                               const RunContext& context = {});

/// Mean distance to the nearest other point, in input units: over all points, or in a large cloud
/// over about 16,384 of them, evenly spread. A few far-off points hardly count. 0 for fewer than
/// two points.
double mean_spacing(std::span<const Vec3f> points, const RunContext& context = {});

}  // namespace stipple
