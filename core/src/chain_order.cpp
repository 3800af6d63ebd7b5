#include "chain_order.hpp"

#include "hilbert_order.hpp"
#include "kernel_sets.hpp"
#include "parallel_for.hpp"

#include <algorithm>

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

}  // namespace

std::vector<Index> chain_order(std::span<const GridPoint> points) {
    const NearestSlot nearest = nearest_slot();
    Window window;
    std::array<Index, kSlots> numbers{};
    Index next = 0;  // along the curve
    const auto fill = [&](int slot) {
        const bool some = next < points.size();
        window.x[slot] = some ? points[next][0] : kGone;
        window.y[slot] = some ? points[next][1] : kGone;
        window.z[slot] = some ? points[next][2] : kGone;
        numbers[static_cast<std::size_t>(slot)] = next++;
    };
    for (int slot = 0; slot < kSlots; ++slot) fill(slot);

    std::vector<Index> order(points.size());
    int slot = 0;
    for (Index& number : order) {
        number = numbers[static_cast<std::size_t>(slot)];
        const GridPoint& p = points[number];
        fill(slot);
        const int from[] = {p[0], p[1], p[2]};
        slot = nearest(window, from);
    }
    return order;
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
