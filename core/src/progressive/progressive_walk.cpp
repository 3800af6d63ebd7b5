#include "progressive/progressive_walk.hpp"

#include "base/parallel_for.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stipple {

/// By where the points are when a round or a batch begins.
void ProgressiveWalk::find_neighbors(const RunContext& context) {
    known_ = places_.size();
    neighbors_ = stipple::find_neighbors(places_, CellBlocks(places_, block_bits_), context);
}

/// Neighbours stay those of the old places; planes go by places on the new grid, each of which is
/// the middle of an old cell until that is split.
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
    views_.clear();
    target_ = std::min(points_, 2 * known_);
    children_.assign(known_, {0, 0});
}

/// What is seen from the next few points does not depend on what is found meanwhile: many threads
/// look ahead.
void ProgressiveWalk::open_visit(const RunContext& context) {
    constexpr std::size_t kAhead = 2'048, kBlock = 128;
    if (visited_ < first_view_ || visited_ >= first_view_ + views_.size()) {
        first_view_ = visited_;
        views_.resize(std::min(kAhead, known_ - visited_));
        parallel_for_blocks(
            views_.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
                for (std::size_t v = begin; v < end; ++v) {
                    const auto i = static_cast<Index>(first_view_ + v);
                    View& view = views_[v];
                    view.tangent = tangent_of(i, neighbors_[i], places_);
                    if (phase_ == Phase::Far) continue;
                    ProgressiveModel::find_candidates(i, neighbors_[i], view.tangent, places_,
                                                      lift_, view.candidates);
                }
            });
    }
    visit_ = {.open = true};
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
