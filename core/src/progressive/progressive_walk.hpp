#pragma once

#include "progressive/progressive_layout.hpp"
#include "progressive/progressive_model.hpp"
#include "stipple/error.hpp"

#include <string>
#include <utility>
#include <vector>

namespace stipple {

/// How the points of a progressive stream come, step by step, on both sides. A batch splits the
/// cells of the points that are there. Then, in rounds in which they become up to twice as many,
/// it asks the cells around each for new ones, and says of those that lie elsewhere how far off
/// they are. A step asks `Side`, which codes what it knows or finds out what the other side knew:
///
///     coder                 RangeEncoder or RangeDecoder
///     fine_cell(i)          where a point lies on the grid of the batch
///     begin_round(k, n)     points k up to n are to come
///     lies_in(cell)         whether one of them that has not come lies in a cell of 2^lift steps,
///                           which is then the next to come
///     begin_far()           from now on those that are left are told by offsets
///     has_far(i)            whether one of these is told by its offset from point i, ...
///     next_cell()           the cell of the next to come
///     added(parent)         it came: its channels are coded
///
/// The decoder's answers do not matter.
class ProgressiveWalk {
public:
    explicit ProgressiveWalk(std::vector<Channel> channels) : model_(std::move(channels)) {}

    ProgressiveModel& model() noexcept { return model_; }
    std::size_t size() const noexcept { return places_.size(); }
    /// The cell of a point, and whether it was split in this batch.
    std::pair<Cell, bool> cell(std::size_t i) const noexcept {
        const bool is_fine = phase_ != Phase::Split || i < visited_;
        const Cell& place = is_fine ? places_[i] : coarse_[i];
        return {{place[0] >> 1, place[1] >> 1, place[2] >> 1}, is_fine};
    }

    /// The first point of all, and the first batch.
    template <typename Side>
    void start(Side& side, const ProgressiveLayout& layout, const RunContext& context) {
        Cell root = side.fine_cell(0);
        model_.code_root(side.coder, root, layout.grid_bits - layout.batches[0].shift);
        places_.push_back(middle_of(root));
        side.added(0);
        begin_batch(side, layout, 0, context);
    }

    template <typename Side>
    void begin_batch(Side& side, const ProgressiveLayout& layout, std::size_t number,
                     const RunContext& context) {
        const ProgressiveLayout::Batch& batch = layout.batches[number];
        points_ = batch.points;
        lift_ = batch.lift;
        block_bits_ = batch.block_bits;
        planes_ = number == 0 ? 0 : layout.batches[number - 1].shift - batch.shift;
        most_ = 1 << (layout.grid_bits - batch.shift);
        find_neighbors(context);
        if (planes_ == 0) {
            begin_round(side);
        } else {
            begin_splitting();
        }
    }

    /// What can be told by few bits: at most 84 bytes and what a point's channels take.
    /// @return false where the batch is over.
    /// @throws Error(MalformedInput) for what no encoder says.
    template <typename Side>
    bool step(Side& side, const RunContext& context) {
        switch (phase_) {
            case Phase::Split:
                return split(side);
            case Phase::Near:
                return look_around(side, context);
            case Phase::Far:
                return look_farther(side, context);
        }
        return false;
    }

private:
    enum class Phase : std::uint8_t { Split, Near, Far };

    /// What is known of a point before it is looked around.
    struct View {
        CellTangent tangent;
        std::vector<Candidate> candidates;
    };
    /// How far it has been looked around.
    struct Visit {
        bool open = false;
        std::size_t next = 0;  ///< of the candidates
        unsigned found = 0;    ///< in that one, or by offsets
    };

    static Cell middle_of(const Cell& cell) noexcept {
        return {2 * cell[0] + 1, 2 * cell[1] + 1, 2 * cell[2] + 1};
    }

    void find_neighbors(const RunContext& context);
    void begin_splitting();
    void begin_round();
    template <typename Side>
    void begin_round(Side& side) {
        begin_round();
        side.begin_round(known_, target_);
    }
    template <typename Side>
    bool end_round(Side& side, const RunContext& context);
    void open_visit(const RunContext& context);
    const View& view() const { return views_[visited_ - first_view_]; }
    void close_visit() {
        visit_.open = false;
        ++visited_;
    }
    double nearest_new(const Cell& middle) const;

    template <typename Side>
    bool split(Side& side);
    template <typename Side>
    bool look_around(Side& side, const RunContext& context);
    template <typename Side>
    bool look_farther(Side& side, const RunContext& context);
    template <typename Side>
    void add(Side& side, const Cell& cell);

    ProgressiveModel model_;
    std::vector<Cell> places_;  ///< middles of the points' cells, in half steps of the batch's grid

    // Of a batch.
    std::size_t points_ = 0;  ///< at its end
    unsigned lift_ = 0, block_bits_ = 0, planes_ = 0;
    std::int32_t most_ = 1;     ///< cells along an axis
    std::vector<Cell> coarse_;  ///< the places as they were, in half steps of the grid before

    // Of a round.
    Phase phase_ = Phase::Near;
    std::size_t known_ = 0, target_ = 0;             ///< points at its begin and end
    std::vector<CellNeighbors> neighbors_;           ///< of those at its begin
    std::vector<std::pair<Index, Index>> children_;  ///< of each, those in cells around it
    std::size_t visited_ = 0;
    std::vector<View> views_;  ///< of some points from one on
    std::size_t first_view_ = 0;
    Visit visit_;
};

template <typename Side>
bool ProgressiveWalk::split(Side& side) {
    if (visited_ == known_) {
        begin_round(side);
        return true;
    }
    const auto i = static_cast<Index>(visited_);
    const CellPlane plane = neighbor_plane(i, neighbors_[i], places_);
    const Cell fine = side.fine_cell(i);
    const Cell bits = model_.split(side.coder, plane, planes_, fine);
    Cell cell;
    for (int axis = 0; axis < 3; ++axis)
        cell[axis] = (coarse_[i][axis] >> 1 << planes_) + bits[axis];
    places_[i] = middle_of(cell);
    ++visited_;
    return true;
}

template <typename Side>
bool ProgressiveWalk::end_round(Side& side, const RunContext& context) {
    if (places_.size() == points_) return false;
    find_neighbors(context);
    begin_round(side);
    return true;
}

template <typename Side>
bool ProgressiveWalk::look_around(Side& side, const RunContext& context) {
    if (places_.size() == target_) return end_round(side, context);
    if (visited_ == known_) {
        phase_ = Phase::Far;
        visited_ = 0;
        side.begin_far();
        return true;
    }
    if (!visit_.open) {
        open_visit(context);
        const auto first = static_cast<Index>(places_.size());
        children_[visited_] = {first, first};
    }
    if (visit_.next == view().candidates.size()) {
        close_visit();
        return true;
    }
    const Candidate& candidate = view().candidates[visit_.next];
    const Cell& middle = candidate.middle;
    const Cell lifted = {middle[0] >> (lift_ + 1), middle[1] >> (lift_ + 1),
                         middle[2] >> (lift_ + 1)};
    const double nearest = visit_.found > 0 ? 0 : nearest_new(middle);
    if (!model_.code_candidate(side.coder, candidate, nearest, visit_.found,
                               side.lies_in(lifted))) {
        ++visit_.next;
        visit_.found = 0;
        return true;
    }
    Cell cell = side.next_cell();
    const Cell bits = model_.place_within(side.coder, candidate, places_[visited_], lift_, cell);
    for (int axis = 0; axis < 3; ++axis) cell[axis] = (lifted[axis] << lift_) + bits[axis];
    add(side, cell);
    ++children_[visited_].second;
    ++visit_.found;
    return true;
}

template <typename Side>
bool ProgressiveWalk::look_farther(Side& side, const RunContext& context) {
    if (places_.size() == target_) return end_round(side, context);
    if (visited_ == known_) {
        throw Error(ErrorCode::MalformedInput, "progressive stream: a batch ends at point " +
                                                   std::to_string(places_.size()) + ": expected " +
                                                   std::to_string(target_));
    }
    if (!visit_.open) open_visit(context);
    if (!model_.code_far(side.coder, view().tangent, visit_.found, side.has_far(visited_))) {
        close_visit();
        return true;
    }
    const Cell from = cell(visited_).first, to = side.next_cell();
    const Cell offset = model_.code_offset(side.coder, view().tangent,
                                           {to[0] - from[0], to[1] - from[1], to[2] - from[2]});
    add(side, {from[0] + offset[0], from[1] + offset[1], from[2] + offset[2]});
    ++visit_.found;
    return true;
}

template <typename Side>
void ProgressiveWalk::add(Side& side, const Cell& cell) {
    for (const std::int32_t c : cell) {
        if (c < 0 || c >= most_) {
            throw Error(ErrorCode::MalformedInput, "progressive stream: point " +
                                                       std::to_string(places_.size()) +
                                                       " lies outside of the grid");
        }
    }
    places_.push_back(middle_of(cell));
    side.added(visited_);
}

}  // namespace stipple
