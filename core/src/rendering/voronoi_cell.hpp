#pragma once

#include "stipple/point_cloud.hpp"

#include <cstddef>
#include <span>
#include <vector>

namespace stipple {

/// Places in a plane around the origin, side by side for vector code; in fours, what is missing
/// lies at the origin.
struct PlanarPlaces {
    std::vector<float> x, y, length_sq;

    /// Makes room for n places, all at the origin.
    void reset(std::size_t n);
};

/// The part of a plane that is nearer to the origin than to any of some places: a polygon, open
/// where no place ends it.
class VoronoiCell {
public:
    static constexpr int kOpen = -1;

    struct Edge {
        int neighbor;    ///< the edge lies half way to it
        int next;        ///< neighbour of the edge that follows anticlockwise; kOpen: none does
        bool is_direct;  ///< whether the middle of the way to the neighbour lies on it
        Eigen::Vector2f corner;  ///< at its end, where another follows
    };

    /// @param places  quickest where the nearest come first. Those at the origin do not count.
    /// O(N) for each edge.
    void find(const PlanarPlaces& places);

    /// Anticlockwise where they go all around; else from some place to the one end, then from there
    /// to the other.
    std::span<const Edge> edges() const noexcept { return edges_; }
    bool is_closed() const noexcept { return is_closed_; }

private:
    void walk(const PlanarPlaces& places, std::size_t count, int start);
    bool is_known(int neighbor) const noexcept;
    /// Whether one of the places from there on is nearer to a corner than the origin.
    bool is_cut(const PlanarPlaces& places, std::size_t from) const noexcept;

    std::vector<Edge> edges_;
    bool is_closed_ = false;
};

}  // namespace stipple
