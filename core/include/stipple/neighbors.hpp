#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <compare>
#include <memory>
#include <span>
#include <vector>

namespace stipple {

/// The neighbours of many points, flat: those of point i are `indices[offsets[i]] ..
/// indices[offsets[i + 1]]`, nearest first, the smaller index first among equals.
struct NeighborLists {
    std::vector<Index> indices;
    std::vector<float> distances_sq;     ///< beside each index, in squared input units
    std::vector<std::uint64_t> offsets;  ///< N + 1

    std::size_t size() const noexcept { return offsets.empty() ? 0 : offsets.size() - 1; }
    std::span<const Index> of(std::size_t i) const noexcept {
        return {indices.data() + offsets[i], indices.data() + offsets[i + 1]};
    }
};

/// A point as it is found from somewhere. Ordered by distance, then index.
struct Neighbor {
    float distance_sq;  ///< squared input units
    Index index;        ///< of the point

    friend auto operator<=>(const Neighbor&, const Neighbor&) = default;
};

/// Finds the points near any position. Holds a copy of the positions: 20 bytes a point.
///
/// All functions are exact in the squared distance as floats have it, dx² + dy² + dz² summed in
/// that order, allocate nothing, and may be called by many threads at once.
class NeighborSearch {
public:
    /// Positions must be finite (`clean`). O(N log N), parallel; about 30 bytes a point more while
    /// it is built.
    explicit NeighborSearch(std::span<const Vec3f> points, const RunContext& context = {});
    ~NeighborSearch();
    NeighborSearch(NeighborSearch&&) noexcept;
    NeighborSearch& operator=(NeighborSearch&&) noexcept;

    /// The number of points.
    std::size_t size() const noexcept;

    /// The nearest points to `q` (finite), as many as `room` has places or as there are; a point
    /// that lies at `q` is among them, at distance 0. Nearest first, the smaller index first among
    /// equals. Quickest for up to 64.
    /// @return the beginning of `room` that was filled. Expected O(k + log N).
    std::span<Neighbor> nearest(const Vec3f& q, std::span<Neighbor> room) const noexcept;

    /// Puts into `found`, which is cleared, all points whose squared distance to `q` (finite) is at
    /// most `radius`²; in an order that depends on the points alone. Nothing for a radius that is
    /// negative or not a number.
    void within(const Vec3f& q, float radius, std::vector<Neighbor>& found) const;

private:
    std::unique_ptr<const class PointTree> tree_;
};

/// The k nearest neighbours N_p of every point (§2), the point itself left out; fewer when there
/// are fewer points.
///
/// Exact: by (squared distance in float, index). Positions must be finite (`clean`).
/// @param k  >= 1. @throws Error(InvalidArgument) for k = 0.
/// Expected O(N k) for points on surfaces; 8 k + 8 bytes a point, and about 50 more while it runs.
NeighborLists k_nearest_neighbors(std::span<const Vec3f> points, unsigned k,
                                  const RunContext& context = {});

/// All points within `radius` (input units, inclusive) of every point, the point itself left out.
/// @throws Error(InvalidArgument) for a radius that is not finite and positive; Error(TooLarge)
/// above 2^32 pairs.
NeighborLists radius_neighbors(std::span<const Vec3f> points, float radius,
                               const RunContext& context = {});

/// Mean distance to the nearest other point, in input units: of all points, or in a large cloud of
/// about 16,384 of them spread evenly over it. A few that lie far off hardly count. 0 for fewer than
/// two points.
double mean_spacing(std::span<const Vec3f> points, const RunContext& context = {});

}  // namespace stipple
