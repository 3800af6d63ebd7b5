#include "cloud/hilbert_order.hpp"

#include "base/counting_sort.hpp"
#include "base/first_touch.hpp"
#include "base/large_memory.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <limits>
#include <utility>

// Follows: C. Hamilton, Compact Hilbert Indices, 2006 (entry point and direction of the subcubes),
// tabulated.

namespace stipple {

namespace {

constexpr std::size_t kBlock = 32'768;
constexpr std::size_t kCrowded = 64;  // points in one cell from which it gets a curve of its own

/// One step down the curve: which subcube comes at which place, and how the curve turns in it.
struct Step {
    std::uint8_t digit;  ///< place of the subcube on the curve, 0..7
    std::uint8_t state;  ///< 3 * entry + direction within it
};

using StepTable = std::array<std::array<Step, 8>, 24>;

constexpr StepTable make_steps() {
    const auto rotate_left = [](unsigned v, unsigned by) {
        return ((v << by) | (v >> (3 - by))) & 7U;
    };
    const auto rotate_right = [&](unsigned v, unsigned by) { return rotate_left(v, (3 - by) % 3); };
    const auto gray = [](unsigned i) { return i ^ (i >> 1U); };
    const auto gray_inverse = [](unsigned g) { return (g ^ (g >> 1U) ^ (g >> 2U)) & 7U; };
    const auto trailing_ones = [](unsigned i) {
        unsigned n = 0;
        for (; (i & 1U) != 0; i >>= 1U) ++n;
        return n;
    };
    const auto entry_of = [&](unsigned w) { return w == 0 ? 0U : gray(2 * ((w - 1) / 2)); };
    const auto direction_of = [&](unsigned w) {
        return (w == 0 ? 0U : w % 2 == 0 ? trailing_ones(w - 1) : trailing_ones(w)) % 3;
    };
    StepTable table{};
    for (unsigned entry = 0; entry < 8; ++entry) {
        for (unsigned direction = 0; direction < 3; ++direction) {
            const unsigned turn = (direction + 1) % 3;
            for (unsigned cube = 0; cube < 8; ++cube) {
                const unsigned w = gray_inverse(rotate_right(cube ^ entry, turn));
                const unsigned next_entry = entry ^ rotate_left(entry_of(w), turn);
                const unsigned next_direction = (direction + direction_of(w) + 1) % 3;
                table[3 * entry + direction][cube] = {
                    static_cast<std::uint8_t>(w),
                    static_cast<std::uint8_t>(3 * next_entry + next_direction)};
            }
        }
    }
    return table;
}

/// Two steps at once: for each state, 64 times that after them, and the two digits; by the two bits
/// of x, from the larger cube to the smaller, then those of y and z above them.
using TwoStepTable = std::array<std::uint16_t, 24 * 64>;

constexpr TwoStepTable make_two_steps() {
    const StepTable steps = make_steps();
    TwoStepTable table{};
    for (unsigned state = 0; state < 24; ++state) {
        for (unsigned x = 0; x < 4; ++x) {
            for (unsigned y = 0; y < 4; ++y) {
                for (unsigned z = 0; z < 4; ++z) {
                    const Step first = steps[state][x / 2 + y / 2 * 2 + z / 2 * 4];
                    const Step second = steps[first.state][x % 2 + y % 2 * 2 + z % 2 * 4];
                    table[64 * state + x + 4 * y + 16 * z] = static_cast<std::uint16_t>(
                        64 * second.state + 8 * first.digit + second.digit);
                }
            }
        }
    }
    return table;
}

constexpr TwoStepTable kTwoSteps = make_two_steps();

/// Cells of a cubic grid over some points.
struct Grid {
    Vec3d low;
    double cells_per_unit;
    unsigned bits;

    /// The cell of a point: 16 bits for each coordinate, z above y above x.
    std::uint64_t cell(const Vec3f& p) const noexcept {
        const double last = static_cast<double>((std::uint64_t{1} << bits) - 1);
        std::array<std::uint64_t, 3> at;
        for (int axis = 0; axis < 3; ++axis) {
            const double c = (static_cast<double>(p[axis]) - low[axis]) * cells_per_unit;
            at[static_cast<std::size_t>(axis)] =
                static_cast<std::uint64_t>(static_cast<std::int64_t>(std::clamp(c, 0.0, last)));
        }
        return at[0] | at[1] << 16U | at[2] << 32U;
    }
    /// The keys of some points, given their cells: side by side, since each step waits for the one
    /// before.
    template <std::size_t kCount>
    void to_keys(std::array<std::uint64_t, kCount>& values) const noexcept {
        constexpr std::uint64_t kTwoOfEach = 0x0003'0003'0003U;
        // Brings the two bits of each coordinate together, from bit 32 on.
        constexpr std::uint64_t kTogether = 1ULL << 32U | 1U << 18U | 1U << 4U;
        std::array<std::uint64_t, kCount> keys{};
        std::array<std::uint64_t, kCount> states{};  // 64 times them
        for (unsigned shift = bits; shift > 0;) {
            shift -= 2;
            for (std::size_t i = 0; i < kCount; ++i) {
                const std::uint64_t cubes =
                    (values[i] >> shift & kTwoOfEach) * kTogether >> 32U & 63U;
                const std::uint64_t steps = kTwoSteps[states[i] | cubes];
                keys[i] = keys[i] << 6U | (steps & 63U);
                states[i] = steps & ~std::uint64_t{63};
            }
        }
        values = keys;
    }
    /// Gives `put(i, key)` the keys of `count` points.
    template <typename PointOf, typename Put>
    void keys(std::size_t count, PointOf&& point, Put&& put) const {
        constexpr std::size_t kSideBySide = 4;
        std::array<std::uint64_t, kSideBySide> values;
        for (std::size_t begin = 0; begin < count; begin += kSideBySide) {
            const std::size_t here = std::min(kSideBySide, count - begin);
            for (std::size_t j = 0; j < kSideBySide; ++j)
                values[j] = cell(point(begin + std::min(j, here - 1)));
            to_keys(values);
            for (std::size_t j = 0; j < here; ++j) put(begin + j, values[j]);
        }
    }
};

struct FloatBox {
    Vec3f low = Vec3f::Constant(std::numeric_limits<float>::infinity());
    Vec3f high = Vec3f::Constant(-std::numeric_limits<float>::infinity());

    void add(const Vec3f& p) noexcept {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
};

/// Cells fine enough that a surface of n points seldom has many in one, or, of a coarse curve, a
/// few dozen; as few bits as that takes, since each two cost a step.
Grid make_grid(const FloatBox& box, std::size_t n, Curve curve, unsigned most_bits) {
    const double extent = (box.high.cast<double>() - box.low.cast<double>()).maxCoeff();
    const int width = std::bit_width(n);
    const int enough = curve == Curve::Fine ? width / 2 + 3 : (width - 1) / 2 - 2;
    const auto wanted = static_cast<unsigned>(std::clamp(enough, 6, 16));
    const unsigned bits = std::min((wanted + 1) / 2 * 2, most_bits / 2 * 2);
    const double cells = static_cast<double>(std::uint64_t{1} << bits);
    return {box.low.cast<double>(), extent > 0 ? cells / extent : 0.0, bits};
}

/// Sorts numbers of which the lowest `ignored` bits are in order already: least digit first, digits
/// that are all alike left out.
void radix_sort(std::span<std::uint64_t> items, std::vector<std::uint64_t>& buffer,
                unsigned ignored, const RunContext& context) {
    std::uint64_t varying = 0;
    for (const std::uint64_t item : items) varying |= item ^ items.front();
    buffer.resize(std::max(buffer.size(), items.size()));
    std::span<std::uint64_t> from = items, to(buffer.data(), items.size());
    for (unsigned shift = ignored; shift < 64; shift += 8) {
        if ((varying >> shift & 0xFFU) == 0) continue;
        context.throw_if_stopped();
        std::array<Index, 257> begin{};
        for (const std::uint64_t item : from) ++begin[(item >> shift & 0xFFU) + 1];
        for (std::size_t digit = 1; digit < begin.size(); ++digit) begin[digit] += begin[digit - 1];
        for (const std::uint64_t item : from) to[begin[item >> shift & 0xFFU]++] = item;
        std::swap(from, to);
    }
    if (from.data() != items.data()) std::ranges::copy(from, items.begin());
}

/// A key above the number of a point, in one number.
struct Packing {
    unsigned index_bits;

    /// Of how many bits a key can be.
    unsigned key_bits() const noexcept { return 64 - index_bits; }
    std::uint64_t packed(std::uint64_t key, std::size_t index) const noexcept {
        return key << index_bits | index;
    }
    std::uint64_t key(std::uint64_t packed) const noexcept { return packed >> index_bits; }
    Index index(std::uint64_t packed) const noexcept {
        return static_cast<Index>(packed & ((std::uint64_t{1} << index_bits) - 1));
    }
};

/// Sorts points by their keys; those of a crowded cell by a curve through their own box.
class PackedOrder {
public:
    PackedOrder(std::span<const Vec3f> points, const Packing& packing, const RunContext& context)
        : points_(points), packing_(packing), context_(context) {}

    /// @param items  ascending by the numbers of the points.
    void put(std::span<std::uint64_t> items, std::span<Index> order) {
        sort(items);
        for (std::size_t i = 0; i < items.size(); ++i) order[i] = packing_.index(items[i]);
    }

private:
    void sort(std::span<std::uint64_t> items) {
        constexpr std::size_t kSmall = 32;  // so few are sorted sooner by comparing them
        if (items.size() <= kSmall) {
            std::ranges::sort(items);
            return;
        }
        radix_sort(items, buffer_, packing_.index_bits, context_);
        for (std::size_t begin = 0; begin < items.size();) {
            const std::uint64_t key = packing_.key(items[begin]);
            std::size_t end = begin + 1;
            while (end < items.size() && packing_.key(items[end]) == key) ++end;
            if (end - begin > kCrowded) refine(items.subspan(begin, end - begin));
            begin = end;
        }
    }
    void refine(std::span<std::uint64_t> items) {
        const auto point = [&](std::size_t i) -> const Vec3f& {
            return points_[packing_.index(items[i])];
        };
        FloatBox box;
        for (std::size_t i = 0; i < items.size(); ++i) box.add(point(i));
        if (box.low == box.high) return;  // one position: in order of number already
        const Grid grid = make_grid(box, items.size(), Curve::Fine, packing_.key_bits() / 3);
        grid.keys(items.size(), point, [&](std::size_t i, std::uint64_t key) {
            items[i] = packing_.packed(key, packing_.index(items[i]));
        });
        sort(items);
    }

    std::span<const Vec3f> points_;
    Packing packing_;
    const RunContext& context_;
    std::vector<std::uint64_t> buffer_;
};

FloatBox box_of(std::span<const Vec3f> points, const RunContext& context) {
    std::vector<FloatBox> boxes((points.size() + kBlock - 1) / kBlock);
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        FloatBox& box = boxes[begin / kBlock];
        Vec3f zeros = Vec3f::Zero();  // of finite numbers, which a box does not tell from others
        for (std::size_t i = begin; i < end; ++i) {
            box.add(points[i]);
            zeros += 0.0F * points[i];
        }
        if (!zeros.allFinite()) box.high.setConstant(std::numeric_limits<float>::infinity());
    });
    FloatBox all;
    for (const FloatBox& box : boxes) {
        all.low = all.low.cwiseMin(box.low);
        all.high = all.high.cwiseMax(box.high);
    }
    return all;
}

}  // namespace

std::vector<Index> hilbert_order(std::span<const Vec3f> points, const RunContext& context,
                                 Curve curve) {
    const std::size_t n = points.size();
    if (n == 0) return {};
    // By the leading bits of the key into buckets, in parallel blocks and stable; then each bucket
    // by itself.
    constexpr unsigned kBucketBits = 12;
    const Packing packing{static_cast<unsigned>(std::bit_width(n - 1))};
    const FloatBox box = box_of(points, context);
    if (!box.low.allFinite() || !box.high.allFinite())
        refuse("positions: expected finite coordinates; remove the points that have others");
    const Grid grid = make_grid(box, n, curve, (packing.key_bits() + kBucketBits) / 3);
    const unsigned bucket_bits = std::min(kBucketBits, 3 * grid.bits);
    const unsigned shift = 3 * grid.bits - bucket_bits;
    const std::size_t buckets = std::size_t{1} << bucket_bits;
    const std::size_t blocks = (n + kBlock - 1) / kBlock;
    LargeArray<std::uint64_t> items(n);
    std::vector<Index> starts(blocks * buckets);
    LargeArray<std::uint64_t> keys(n);
    parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
        Index* count = starts.data() + begin / kBlock * buckets;
        grid.keys(
            end - begin, [&](std::size_t i) -> const Vec3f& { return points[begin + i]; },
            [&](std::size_t i, std::uint64_t key) {
                keys[begin + i] = key;
                ++count[key >> shift];
            });
    });
    const std::vector<Index> bucket_begin = counts_to_places(starts, buckets);
    parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
        const std::uint64_t below = (std::uint64_t{1} << shift) - 1;
        Index* next = starts.data() + begin / kBlock * buckets;
        for (std::size_t i = begin; i < end; ++i)
            items[next[keys[i] >> shift]++] = packing.packed(keys[i] & below, i);
    });
    keys = {};

    auto order = made_in_blocks<std::vector<Index>>(n, context);
    parallel_for_blocks(buckets, 16, context, [&](std::size_t begin, std::size_t end) {
        PackedOrder sorted(points, packing, context);
        for (std::size_t bucket = begin; bucket < end; ++bucket) {
            const std::size_t first = bucket_begin[bucket],
                              count = bucket_begin[bucket + 1] - first;
            sorted.put(std::span(items).subspan(first, count),
                       std::span(order).subspan(first, count));
        }
    });
    return order;
}

}  // namespace stipple
