// Compiled for several instruction sets by chain_order.cpp; see kernel_sets.hpp.

inline int distance(const Window& window, int slot, const Place& from) noexcept {
    const int dx = window.x[slot] - from.x;
    const int dy = window.y[slot] - from.y;
    const int dz = window.z[slot] - from.z;
    return (dx < 0 ? -dx : dx) + (dy < 0 ? -dy : dy) + (dz < 0 ? -dz : dz);
}

/// The slot whose point is nearest to `from`, by the sum of the differences of its coordinates; the
/// first of several.
inline int nearest_slot(const Window& window, const Place& from) noexcept {
    int least = kNone;
    for (int slot = 0; slot < kSlots; ++slot) {
        const int key = kSlots * distance(window, slot, from) + slot;
        least = key < least ? key : least;
    }
    return least % kSlots;
}

void nearest_slots(const Window* windows, const Place* from, int* slots, int chains) noexcept {
    for (int c = 0; c < chains; ++c) slots[c] = nearest_slot(windows[c], from[c]);
}

/// The slot of the fewest bits: of the least product of the sums of differences, each plus one; the
/// first of several.
int cheapest_slot(const ColoredWindow& window, const ColoredPlace& from) noexcept {
    alignas(32) float cost[kColoredSlots];
    for (int slot = 0; slot < kColoredSlots; ++slot) {
        float sums[] = {1, 1};
        for (int c = 0; c < kChannels; ++c) {
            const float d = window.channel[c][slot] - from.channel[c];
            sums[c / 3] += d < 0 ? -d : d;
        }
        cost[slot] = sums[0] * sums[1];
    }
    // Of positive floats the bits are in the same order.
    alignas(32) std::int32_t bits[kColoredSlots];
    __builtin_memcpy(bits, cost, sizeof bits);
    std::int32_t least = kNone;
    for (int slot = 0; slot < kColoredSlots; ++slot)
        least = bits[slot] < least ? bits[slot] : least;
    for (int slot = 0; slot < kColoredSlots; ++slot)
        if (bits[slot] == least) return slot;
    return 0;
}

using Bytes = std::uint8_t __attribute__((vector_size(32)));

[[gnu::always_inline]] inline Bytes load(const std::uint8_t* from) noexcept {
    Bytes v;
    __builtin_memcpy(&v, from, sizeof v);
    return v;
}
[[gnu::always_inline]] inline Bytes smaller(Bytes a, Bytes b) noexcept {
    return a < b ? a : b;
}
[[gnu::always_inline]] inline Bytes difference(Bytes a, Bytes b) noexcept {
    return (a > b ? a : b) - smaller(a, b);
}
/// At most 255.
[[gnu::always_inline]] inline Bytes sum(Bytes a, Bytes b) noexcept {
#if defined(STIPPLE_KERNELS_AVX2)
    return reinterpret_cast<Bytes>(
        _mm256_adds_epu8(reinterpret_cast<__m256i>(a), reinterpret_cast<__m256i>(b)));
#else
    return a + smaller(b, ~a);
#endif
}

inline std::uint8_t least_of(Bytes v) noexcept {
    std::uint8_t lanes[sizeof v];
    __builtin_memcpy(lanes, &v, sizeof v);
#if defined(__SSE4_1__)
    __m128i halves[2];
    __builtin_memcpy(halves, &v, sizeof v);
    const __m128i least = _mm_min_epu8(halves[0], halves[1]);
    const __m128i pairs = _mm_min_epu8(least, _mm_srli_epi16(least, 8));
    return static_cast<std::uint8_t>(_mm_cvtsi128_si32(_mm_minpos_epu16(pairs)));
#else
    std::uint8_t least = lanes[0];
    for (const std::uint8_t lane : lanes) least = lane < least ? lane : least;
    return least;
#endif
}

inline std::uint32_t lane_bits(Bytes mask) noexcept {
#if defined(STIPPLE_KERNELS_AVX2)
    return static_cast<std::uint32_t>(_mm256_movemask_epi8(reinterpret_cast<__m256i>(mask)));
#elif defined(__SSE2__)
    __m128i halves[2];
    __builtin_memcpy(halves, &mask, sizeof mask);
    return static_cast<std::uint32_t>(_mm_movemask_epi8(halves[0])) |
           static_cast<std::uint32_t>(_mm_movemask_epi8(halves[1])) << 16U;
#else
    std::uint32_t bits = 0;
    for (unsigned lane = 0; lane < sizeof mask; ++lane) bits |= (mask[lane] & 1U) << lane;
    return bits;
#endif
}

/// The first lane that is set; one is.
inline int first_of(const std::uint64_t lanes[2]) noexcept {
    const std::uint64_t none = -std::uint64_t{lanes[0] == 0};  // no branch: nobody foretells it
    return __builtin_ctzll((lanes[0] & ~none) | (lanes[1] & none)) + static_cast<int>(64 & none);
}

/// The same of several windows, where the nearest is mostly a point of the same block, less than
/// 255 away: by bytes. Another block may have the same byte: what is found is measured again.
void nearest_in_block(const Window* windows, const Place* from, int* slots, int chains) noexcept {
    constexpr int kWidth = sizeof(Bytes), kParts = kSlots / kWidth;
    Bytes distances[kAtOnce][kParts], least[kAtOnce];
    for (int c = 0; c < chains; ++c) {
        const Window& window = windows[c];
        least[c] = ~Bytes{};
        for (int part = 0; part < kParts; ++part) {
            const int at = part * kWidth;
            const Bytes dx = difference(load(window.low_x + at), Bytes{} + from[c].low_x);
            const Bytes dy = difference(load(window.low_y + at), Bytes{} + from[c].low_y);
            const Bytes dz = difference(load(window.low_z + at), Bytes{} + from[c].low_z);
            const auto same =
                reinterpret_cast<Bytes>(load(window.block + at) == Bytes{} + from[c].block);
            distances[c][part] = sum(sum(dx, dy), dz) | ~same;
            least[c] = smaller(least[c], distances[c][part]);
        }
    }
    std::uint8_t found[kAtOnce];
    for (int c = 0; c < chains; ++c) found[c] = least_of(least[c]);
    for (int c = 0; c < chains; ++c) {
        std::uint64_t lanes[2] = {};
        for (int part = 0; part < kParts; ++part) {
            const auto equal = reinterpret_cast<Bytes>(distances[c][part] == Bytes{} + found[c]);
            lanes[part / 2] |= std::uint64_t{lane_bits(equal)} << (part % 2 * kWidth);
        }
        slots[c] = first_of(lanes);
    }
    for (int c = 0; c < chains; ++c) {
        if (found[c] == 255 || distance(windows[c], slots[c], from[c]) != found[c])
            slots[c] = nearest_slot(windows[c], from[c]);
    }
}
