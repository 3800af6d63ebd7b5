#include "cloud/chain_order.hpp"

#include "base/kernel_sets.hpp"
#include "base/parallel_for.hpp"
#include "cloud/hilbert_order.hpp"

#include <algorithm>
#include <cstdint>
#include <numeric>

namespace stipple {

namespace {

constexpr int kSlots = 128;
constexpr int kAtOnce = 4;  // chains
constexpr int kNone = 0x7FFFFFFF;
constexpr std::size_t kPiece = 65'536;  // points of a long chain that are taken at once
constexpr int kGone = 1 << 20;          // a coordinate farther from all points than any of them

/// Points that are left, from among which the next one is taken.
struct Window {
    alignas(32) int x[kSlots], y[kSlots], z[kSlots];
    alignas(32) std::uint8_t low_x[kSlots], low_y[kSlots], low_z[kSlots];  ///< of those
    alignas(32) std::uint8_t block[kSlots];  ///< the same for all points of a block
};
struct Place {
    int x, y, z;
    std::uint8_t low_x, low_y, low_z, block;
};

constexpr int kColoredSlots = 256;
constexpr int kChannels = 6;  // x, y, z, red, green, blue

/// The same, of points with colours.
struct ColoredWindow {
    alignas(32) float channel[kChannels][kColoredSlots];
};
struct ColoredPlace {
    float channel[kChannels];
};

#define STIPPLE_KERNELS_BODY "cloud/chain_order_body.hpp"
#include "base/kernel_sets_of_body.hpp"

/// The slots of the next points of chains, `kAtOnce` at most, given those taken last.
using NearestSlots = void (*)(const Window* windows, const Place* from, int* slots,
                              int chains) noexcept;

NearestSlots nearest_slots() {
    static const std::vector<NearestSlots> available =
        with_avx2<NearestSlots>(plain::nearest_slots, avx2::nearest_slots);
    return quickest(available);
}
NearestSlots nearest_in_block() {
    static const std::vector<NearestSlots> available =
        with_avx2<NearestSlots>(plain::nearest_in_block, avx2::nearest_in_block);
    return quickest(available);
}

using CheapestSlot = int (*)(const ColoredWindow& window, const ColoredPlace& from) noexcept;

CheapestSlot cheapest_slot() {
    static const std::vector<CheapestSlot> available =
        with_avx2<CheapestSlot>(plain::cheapest_slot, avx2::cheapest_slot);
    return quickest(available);
}

/// Chains through the stretches of points that `ends` divides: several at once, since the next link
/// of a chain waits for the one before.
template <typename CoordinateAt>
class Chains {
public:
    Chains(const std::span<const std::size_t>& ends, const CoordinateAt& coordinate_at)
        : coordinate_at_(coordinate_at), size_(ends.size()) {
        for (std::size_t c = 0; c < size_; ++c) {
            next_[c] = c == 0 ? 0 : ends[c - 1];
            end_[c] = ends[c];
            for (int slot = 0; slot < kSlots; ++slot) fill(c, slot);
            from_[c] = place(windows_[c], 0);
        }
    }

    /// Calls next(chain, number) with the next point of each. Its slot is filled at once: what was
    /// written has arrived when the window is looked at again.
    template <typename Next>
    void take(NearestSlots nearest, Next&& next) {
        std::array<int, kAtOnce> slots;
        nearest(windows_.data(), from_.data(), slots.data(), static_cast<int>(size_));
        for (std::size_t c = 0; c < size_; ++c) {
            from_[c] = place(windows_[c], slots[c]);
            next(c, numbers_[c][static_cast<std::size_t>(slots[c])]);
            fill(c, slots[c]);
        }
    }

private:
    static Place place(const Window& w, int slot) {
        return {w.x[slot],     w.y[slot],     w.z[slot],    w.low_x[slot],
                w.low_y[slot], w.low_z[slot], w.block[slot]};
    }
    void fill(std::size_t c, int slot) {
        const bool some = next_[c] < end_[c];
        const auto i = static_cast<Index>(next_[c]++);
        const int x = some ? coordinate_at_(i, 0) : kGone;
        const int y = some ? coordinate_at_(i, 1) : kGone;
        const int z = some ? coordinate_at_(i, 2) : kGone;
        Window& w = windows_[c];
        w.x[slot] = x;
        w.y[slot] = y;
        w.z[slot] = z;
        w.low_x[slot] = static_cast<std::uint8_t>(x);
        w.low_y[slot] = static_cast<std::uint8_t>(y);
        w.low_z[slot] = static_cast<std::uint8_t>(z);
        w.block[slot] = static_cast<std::uint8_t>((x >> 8) + 37 * (y >> 8) + 101 * (z >> 8));
        numbers_[c][static_cast<std::size_t>(slot)] = i;
    }

    std::array<Window, kAtOnce> windows_;
    std::array<Place, kAtOnce> from_{};  ///< the points taken last
    std::array<std::array<Index, kSlots>, kAtOnce> numbers_{};
    std::array<std::size_t, kAtOnce> next_{}, end_{};
    const CoordinateAt& coordinate_at_;
    std::size_t size_;
};

/// @param coordinate_at  coordinate_at(i, axis) of the i-th of `count` points: at least 0, and less
/// than 2^19.
template <typename CoordinateAt>
void chain(std::size_t count, const CoordinateAt& coordinate_at, NearestSlots nearest,
           std::vector<Index>& order) {
    constexpr std::size_t kMany = 8'192;
    const std::size_t chains = count < kMany ? 1 : kAtOnce, each = count / chains;
    std::array<std::size_t, kAtOnce> ends = {each, 2 * each, 3 * each};
    ends[chains - 1] = count;
    Chains open({ends.data(), chains}, coordinate_at);
    order.resize(count);
    for (std::size_t i = 0; i < each; ++i)
        open.take(nearest, [&](std::size_t c, Index number) { order[c * each + i] = number; });
    for (std::size_t i = chains * each; i < count; ++i)  // the last has a few more
        open.take(nearest, [&](std::size_t c, Index number) {
            if (c + 1 == chains) order[i] = number;
        });
}

/// Calls next(number) with each of the places in turn.
template <typename Next>
void chain(std::span<const ColoredPlace> places, Next&& next) {
    const CheapestSlot cheapest = cheapest_slot();
    constexpr float kNowhere = 1e18F;  // farther than any point, by position and by colour
    ColoredWindow window;
    std::array<Index, kColoredSlots> numbers{};
    Index waiting = 0;
    const auto fill = [&](int slot) {
        const bool some = waiting < places.size();
        for (int c = 0; c < kChannels; ++c)
            window.channel[c][slot] = some ? places[waiting].channel[c] : kNowhere;
        numbers[static_cast<std::size_t>(slot)] = waiting++;
    };
    for (int slot = 0; slot < kColoredSlots; ++slot) fill(slot);
    Index at = 0;
    for (std::size_t i = 0; i < places.size(); ++i) {
        const int slot = cheapest(window, places[at]);
        at = numbers[static_cast<std::size_t>(slot)];
        next(at);
        fill(slot);
    }
}

}  // namespace

std::vector<Index> chain_order(std::span<const GridPoint> points) {
    std::vector<Index> order;
    chain(
        points.size(), [&](Index i, std::size_t axis) { return int{points[i][axis]}; },
        nearest_slots(), order);
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
    chain(points.size(), coordinate_at, nearest_in_block(), order_);
    for (Index& i : order_) i = grouped_[i];
    return order_;
}

std::vector<Index> chain_through(std::span<const Vec3f> points, const RunContext& context) {
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

std::vector<Index> chain_through(std::span<const Vec3f> points, double step,
                                 std::span<const Rgba8> colors, const RunContext& context) {
    const std::vector<Index> curve = hilbert_order(points, context);
    std::vector<Index> order(points.size());
    parallel_for_blocks(points.size(), kPiece, context, [&](std::size_t begin, std::size_t end) {
        const std::span<const Index> piece = std::span(curve).subspan(begin, end - begin);
        const Vec3d low = points[piece.front()].cast<double>();
        std::vector<ColoredPlace> places(piece.size());
        for (std::size_t i = 0; i < piece.size(); ++i) {
            const Vec3d at = (points[piece[i]].cast<double>() - low) / step;
            const Rgba8& color = colors[piece[i]];
            places[i] = {{static_cast<float>(at.x()), static_cast<float>(at.y()),
                          static_cast<float>(at.z()), static_cast<float>(color.r),
                          static_cast<float>(color.g), static_cast<float>(color.b)}};
        }
        std::size_t to = begin;
        chain(places, [&](Index i) { order[to++] = piece[i]; });
    });
    return order;
}

}  // namespace stipple
