#include "progressive_walk.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stipple {

void ProgressiveWalk::find_blocks() {
    known_ = places_.size();
    blocks_ = CellBlocks(places_, block_bits_);
    CellNeighbors unknown;
    unknown.count = std::numeric_limits<std::uint8_t>::max();
    neighbors_.assign(known_, unknown);
}

void ProgressiveWalk::begin_splitting() {
    phase_ = Phase::Split;
    visited_ = 0;
    coarse_ = places_;
    for (Cell& place : places_)
        for (std::int32_t& c : place) c <<= planes_;
}

void ProgressiveWalk::begin_round() {
    phase_ = Phase::Near;
    visited_ = 0;
    visit_.open = false;
    target_ = std::min(points_, 2 * known_);
    children_.assign(known_, {0, 0});
}

/// By where the points were when the round or the batch began.
const CellNeighbors& ProgressiveWalk::neighbors_of(Index i) {
    CellNeighbors& neighbors = neighbors_[i];
    if (neighbors.count > kMostCellNeighbors) {
        const std::vector<Cell>& places = phase_ == Phase::Split ? coarse_ : places_;
        neighbors = find_neighbors(i, std::span(places).first(known_), blocks_);
    }
    return neighbors;
}

void ProgressiveWalk::open_visit() {
    const auto i = static_cast<Index>(visited_);
    visit_.tangent = tangent_of(i, neighbors_of(i), places_);
    visit_.found = 0;
    visit_.open = true;
}

/// How far from the middle of a cell the nearest lies that came in this round, in its sides.
double ProgressiveWalk::nearest_new(const Cell& middle) const {
    std::int64_t nearest = std::numeric_limits<std::int64_t>::max();
    const auto look = [&](Index parent) {
        for (Index i = children_[parent].first; i < children_[parent].second; ++i)
            nearest = std::min(nearest, distance_sq(places_[i], middle));
    };
    const auto i = static_cast<Index>(visited_);
    look(i);
    std::ranges::for_each(neighbors_[i].list(), look);
    return std::sqrt(static_cast<double>(nearest)) / static_cast<double>(2U << lift_);
}

}  // namespace stipple
