#include "chain_order.hpp"

#include "hilbert_order.hpp"
#include "kernel_sets.hpp"
#include "parallel_for.hpp"

#include <algorithm>
#include <numeric>

namespace stipple {

namespace {

constexpr int kSlots = 128;
constexpr int kNone = 0x7FFFFFFF;
constexpr int kGone = 1 << 20;  // a coordinate farther from all points than any of them

/// Points that are left, from among which the next one is taken.
struct Window {
    alignas(32) int x[kSlots], y[kSlots], z[kSlots];
};

#define STIPPLE_KERNELS_BODY "chain_order_body.hpp"
#include "kernel_sets_of_body.hpp"

using NearestSlot = int (*)(const Window&, const int from[3]) noexcept;

NearestSlot nearest_slot() {
    static const std::vector<NearestSlot> available =
        with_avx2<NearestSlot>(plain::nearest_slot, avx2::nearest_slot);
    return quickest(available);
}

/// A chain through the points begin..end.
template <typename CoordinateAt>
class Chain {
public:
    Chain(std::size_t begin, std::size_t end, const CoordinateAt& coordinate_at)
        : next_(begin), end_(end), coordinate_at_(&coordinate_at) {
        for (int slot = 0; slot < kSlots; ++slot) fill(slot);
    }

    /// The next point.
    Index take(NearestSlot nearest) {
        const int from[] = {window_.x[slot_], window_.y[slot_], window_.z[slot_]};
        const Index number = numbers_[static_cast<std::size_t>(slot_)];
        fill(slot_);
        slot_ = nearest(window_, from);
        return number;
    }

private:
    void fill(int slot) {
        const bool some = next_ < end_;
        const auto i = static_cast<Index>(next_);
        window_.x[slot] = some ? (*coordinate_at_)(i, 0) : kGone;
        window_.y[slot] = some ? (*coordinate_at_)(i, 1) : kGone;
        window_.z[slot] = some ? (*coordinate_at_)(i, 2) : kGone;
        numbers_[static_cast<std::size_t>(slot)] = i;
        ++next_;
    }

    Window window_;
    std::array<Index, kSlots> numbers_{};
    std::size_t next_, end_;
    const CoordinateAt* coordinate_at_;
    int slot_ = 0;
};

/// @param coordinate_at  coordinate_at(i, axis) of the i-th of `count` points: at least 0, and less
/// than 2^19.
template <typename CoordinateAt>
void chain(std::size_t count, const CoordinateAt& coordinate_at, std::vector<Index>& order) {
    // The next link of a chain waits for the one before: many points are four chains at once.
    constexpr std::size_t kMany = 8'192, kAtOnce = 4;
    const std::size_t chains = count < kMany ? 1 : kAtOnce, each = count / chains;
    std::vector<Chain<CoordinateAt>> open;
    for (std::size_t c = 0; c < chains; ++c)
        open.emplace_back(c * each, c + 1 < chains ? (c + 1) * each : count, coordinate_at);
    const NearestSlot nearest = nearest_slot();
    order.resize(count);
    for (std::size_t i = 0; i < each; ++i)
        for (std::size_t c = 0; c < chains; ++c) order[c * each + i] = open[c].take(nearest);
    for (std::size_t i = chains * each; i < count; ++i) order[i] = open.back().take(nearest);
}

}  // namespace

std::vector<Index> chain_order(std::span<const GridPoint> points) {
    std::vector<Index> order;
    chain(
        points.size(), [&](Index i, std::size_t axis) { return int{points[i][axis]}; }, order);
    return order;
}

/// Points of one block after those of another, blocks as the curve first comes to them.
void BlockChain::group(std::span<const GridPoint> points) {
    runs_.clear();
    blocks_.clear();
    begins_.assign(1, 0);
    std::uint32_t last = 0;
    for (Index i = 0; i < points.size(); ++i) {
        const auto& [x, y, z] = points[i];
        const std::uint32_t name = (x >> 8U) << 16U | (y >> 8U) << 8U | z >> 8U;
        if (i == 0 || name != last) {
            if (i > 0) begins_[runs_.back().block + 1] += i - runs_.back().begin;
            const auto number = static_cast<Index>(blocks_.size());
            runs_.push_back({blocks_.try_emplace(name, number).first->second, i});
            begins_.resize(blocks_.size() + 1);
        }
        last = name;
    }
    if (!runs_.empty())
        begins_[runs_.back().block + 1] += static_cast<Index>(points.size()) - runs_.back().begin;
    std::partial_sum(begins_.begin(), begins_.end(), begins_.begin());
    grouped_.resize(points.size());
    for (std::size_t r = 0; r < runs_.size(); ++r) {
        const auto end = r + 1 < runs_.size() ? runs_[r + 1].begin : points.size();
        Index& to = begins_[runs_[r].block];
        for (Index i = runs_[r].begin; i < end; ++i) grouped_[to++] = i;
    }
}

std::span<const Index> BlockChain::order(std::span<const GridPoint> points) {
    constexpr int kApart = 1'024;  // steps between blocks: more than within one, which a chain so
                                   // leaves when it is done
    group(points);
    const auto coordinate_at = [&](Index i, std::size_t axis) {
        const unsigned coordinate = points[grouped_[i]][axis];
        return static_cast<int>(coordinate + kApart * (coordinate / 256));
    };
    chain(points.size(), coordinate_at, order_);
    for (Index& i : order_) i = grouped_[i];
    return order_;
}

std::vector<Index> chain_through(std::span<const Vec3f> points, const RunContext& context) {
    constexpr std::size_t kPiece = 65'536;
    constexpr double kSteps = 65'535;
    const std::vector<Index> curve = hilbert_order(points, context);
    std::vector<Index> order(points.size());
    parallel_for_blocks(points.size(), kPiece, context, [&](std::size_t begin, std::size_t end) {
        const std::span<const Index> piece = std::span(curve).subspan(begin, end - begin);
        Vec3d low = points[piece.front()].cast<double>(), high = low;
        for (const Index i : piece) {
            low = low.cwiseMin(points[i].cast<double>());
            high = high.cwiseMax(points[i].cast<double>());
        }
        const double side = (high - low).maxCoeff();
        const double steps = side > 0 ? kSteps / side : 0.0;
        std::vector<GridPoint> places(piece.size());
        for (std::size_t i = 0; i < piece.size(); ++i) {
            const Vec3d place = steps * (points[piece[i]].cast<double>() - low);
            for (std::size_t axis = 0; axis < 3; ++axis)
                places[i][axis] =
                    static_cast<std::uint16_t>(place[static_cast<Eigen::Index>(axis)]);
        }
        std::ranges::transform(chain_order(places), order.begin() + static_cast<long>(begin),
                               [&](Index i) { return piece[i]; });
    });
    return order;
}

}  // namespace stipple
