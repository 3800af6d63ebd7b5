#include "clustering/gather.hpp"

#include "cloud/float4.hpp"

#include <array>
#include <bit>

namespace stipple {

namespace {

/// Keeps in `near` the sample nearest to `target`; the smaller number among equals.
void keep_nearest(Near& near, const SampleSpan& samples, const Vec3f& target) {
    const auto distance_sq = [&](std::size_t i) {
        const Group g =
            i + 4 <= samples.size ? Group(samples, i, target) : Group::tail(samples, i, target);
        return g.x * g.x + g.y * g.y + g.z * g.z;
    };
    constexpr float kFar = std::numeric_limits<float>::infinity();
    Float4 least = {kFar, kFar, kFar, kFar};
    const std::size_t whole = samples.size / 4 * 4;
    for (std::size_t i = 0; i < whole; i += 4) {
        const Float4 d = distance_sq(i);
        least = d < least ? d : least;
    }
    float least_sq = std::min({least[0], least[1], least[2], least[3]});
    if (whole < samples.size) {
        const Float4 d = distance_sq(whole);
        for (std::size_t lane = 0; whole + lane < samples.size; ++lane)
            least_sq = std::min(least_sq, d[lane]);
    }
    if (least_sq > near.distance_sq) return;
    for (std::size_t i = 0; i < samples.size; i += 4) {
        for (unsigned lanes = lane_bits(distance_sq(i) <= least_sq); lanes != 0;
             lanes &= lanes - 1) {
            const std::size_t at = i + static_cast<std::size_t>(std::countr_zero(lanes));
            if (at >= samples.size) break;
            if (least_sq < near.distance_sq || samples.index[at] < near.index)
                near = {least_sq, samples.index[at], samples.position(at)};
        }
    }
}

}  // namespace

void gather(std::span<const Vec3f> points, std::span<const Index> numbers,
            const MutableSampleSpan& to) noexcept {
    // Few stores, since they are what takes the time: x and y of four points at once.
    using Float2 = float __attribute__((vector_size(8)));
    constexpr std::size_t kAhead = 16;  // that far the memory is asked for in advance
    const std::size_t whole = numbers.size() / 4 * 4;
    for (std::size_t i = 0; i < whole; i += 4) {
        std::array<Float2, 4> xy;
        for (std::size_t lane = 0; lane < 4; ++lane) {
            __builtin_prefetch(&points[numbers[std::min(i + lane + kAhead, whole - 1)]]);
            const Vec3f& p = points[numbers[i + lane]];
            __builtin_memcpy(&xy[lane], p.data(), sizeof(Float2));
            to.z[i + lane] = p.z();
        }
        const Float4 first = __builtin_shufflevector(xy[0], xy[1], 0, 1, 2, 3),
                     last = __builtin_shufflevector(xy[2], xy[3], 0, 1, 2, 3);
        const Float4 x = __builtin_shufflevector(first, last, 0, 2, 4, 6),
                     y = __builtin_shufflevector(first, last, 1, 3, 5, 7);
        __builtin_memcpy(to.x + i, &x, sizeof x);
        __builtin_memcpy(to.y + i, &y, sizeof y);
    }
    for (std::size_t i = whole; i < numbers.size(); ++i) {
        const Vec3f& p = points[numbers[i]];
        to.x[i] = p.x();
        to.y[i] = p.y();
        to.z[i] = p.z();
    }
    std::copy_n(numbers.data(), numbers.size(), to.index);
}

Near Gathered::nearest_to(const Vec3f& target, std::span<const Index> members) {
    Near near;
    near.index = members.front();  // where no distance is a number
    near.position = first_of(members);
    each_piece(members, [&](const SampleSpan& samples) { keep_nearest(near, samples, target); });
    return near;
}

}  // namespace stipple
