// No header of its own: cluster_kernels.cpp includes it once for each instruction set, in a
// namespace of its own. It uses eight lanes as the compiler makes them of what the set has; only
// packing is written for each.

using Float8 = float __attribute__((vector_size(32)));
using Int8 = std::int32_t __attribute__((vector_size(32)));

constexpr std::size_t kLanes = 8;
constexpr std::size_t kFlush = 16;  // groups of eight summed up in floats

struct Group {
    Float8 x, y, z;
};

inline Float8 load(const float* from) noexcept {
    Float8 v;
    __builtin_memcpy(&v, from, sizeof v);
    return v;
}

/// Eight samples relative to a reference.
inline Group whole_group(const SampleSpan& s, std::size_t i,
                         const std::array<float, 3>& reference) noexcept {
    return {load(s.x + i) - reference[0], load(s.y + i) - reference[1],
            load(s.z + i) - reference[2]};
}

/// The last samples; what is missing stands at the reference, where it adds nothing.
inline Group last_group(const SampleSpan& s, std::size_t i,
                        const std::array<float, 3>& reference) noexcept {
    std::array<std::array<float, kLanes>, 3> padded;
    for (std::size_t axis = 0; axis < 3; ++axis) padded[axis].fill(reference[axis]);
    for (std::size_t j = 0; i + j < s.size; ++j) {
        padded[0][j] = s.x[i + j];
        padded[1][j] = s.y[i + j];
        padded[2][j] = s.z[i + j];
    }
    return {load(padded[0].data()) - reference[0], load(padded[1].data()) - reference[1],
            load(padded[2].data()) - reference[2]};
}

#if defined(STIPPLE_KERNELS_AVX2)

inline unsigned lane_bits(Int8 mask) noexcept {
    return static_cast<unsigned>(_mm256_movemask_ps(reinterpret_cast<__m256>(mask)));
}

inline Float8 smaller(Float8 a, Float8 b) noexcept {
    return _mm256_min_ps(a, b);
}
inline Float8 larger(Float8 a, Float8 b) noexcept {
    return _mm256_max_ps(a, b);
}

/// The lanes to the left and the others, each packed to the front.
struct Packing {
    __m256i left_order, right_order;

    explicit Packing(unsigned left) noexcept
        : left_order(order_of(left)), right_order(order_of(~left & 255U)) {}

    /// Eight values from one place to two; behind those that belong there up to seven become
    /// anything.
    template <typename T>
    void move(const T* from, T* left, T* right) const noexcept {
        const __m256i v = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(from));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(right),
                            _mm256_permutevar8x32_epi32(v, right_order));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(left),
                            _mm256_permutevar8x32_epi32(v, left_order));
    }

    static __m256i order_of(unsigned mask) noexcept {
        return _mm256_cvtepu8_epi32(
            _mm_loadl_epi64(reinterpret_cast<const __m128i*>(&kPackedLanes[mask])));
    }
};

/// Some of eight values, packed; behind them up to seven become anything.
struct Selection {
    __m256i order;

    explicit Selection(unsigned mask) noexcept : order(Packing::order_of(mask)) {}
    template <typename V, typename T>
    void store(const V& v, T* to) const noexcept {
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(to),
                            _mm256_permutevar8x32_epi32(reinterpret_cast<__m256i>(v), order));
    }
};

#else

inline unsigned lane_bits(Int8 mask) noexcept {
    unsigned bits = 0;
    for (unsigned half = 0; half < 2; ++half) {
        std::array<std::int32_t, 4> lanes;
        __builtin_memcpy(lanes.data(), reinterpret_cast<const char*>(&mask) + 16 * half, 16);
        Int4 part;
        __builtin_memcpy(&part, lanes.data(), 16);
        bits |= stipple::lane_bits(part) << (4 * half);
    }
    return bits;
}

inline Float8 smaller(Float8 a, Float8 b) noexcept {
    return a < b ? a : b;
}
inline Float8 larger(Float8 a, Float8 b) noexcept {
    return a > b ? a : b;
}

struct Packing {
    unsigned left;

    template <typename T>
    void move(const T* from, T* to_left, T* to_right) const noexcept {
        // Read whole before anything is written: `to_left` may be the same place.
        std::array<T, kLanes> v;
        __builtin_memcpy(v.data(), from, sizeof v);
        const auto pack = [&v](T* to, unsigned mask) {
            store_packed(to, v.data(), mask & 15U);
            store_packed(to + std::popcount(mask & 15U), v.data() + 4, mask >> 4U);
        };
        pack(to_right, ~left & 255U);
        pack(to_left, left);
    }
};

struct Selection {
    unsigned mask;

    template <typename V, typename T>
    void store(const V& v, T* to) const noexcept {
        std::array<T, kLanes> lanes;
        __builtin_memcpy(lanes.data(), &v, sizeof v);
        store_packed(to, lanes.data(), mask & 15U);
        store_packed(to + std::popcount(mask & 15U), lanes.data() + 4, mask >> 4U);
    }
};

#endif

/// Copies n values, eight at a time: most clusters are so small that a call to memcpy costs more.
template <typename T>
inline void copy(const T* from, std::size_t n, T* to) noexcept {
    std::size_t i = 0;
    for (; i + kLanes <= n; i += kLanes) __builtin_memcpy(to + i, from + i, kLanes * sizeof(T));
    for (; i < n; ++i) to[i] = from[i];
}

std::size_t partition(const MutableSampleSpan& samples, const SplitPlane& split_plane,
                      const MutableSampleSpan& scratch_space) noexcept {
    // Copies that no store can reach, so that they stay in registers.
    const MutableSampleSpan s = samples, scratch = scratch_space;
    const SplitPlane plane = split_plane;
    const auto left_of = [plane](const Group& g) {
        return lane_bits(g.x * plane.normal[0] + g.y * plane.normal[1] + g.z * plane.normal[2] <
                         plane.offset);
    };
    std::size_t front = 0, back = 0;
    const std::size_t whole = s.size / kLanes * kLanes;
    // Neither side is longer than what was read, so a store of eight reaches no further than the
    // eight just read.
    for (std::size_t i = 0; i < whole; i += kLanes) {
        const unsigned left = left_of(whole_group(s, i, plane.reference));
        const Packing packing{left};
        packing.move(s.x + i, s.x + front, scratch.x + back);
        packing.move(s.y + i, s.y + front, scratch.y + back);
        packing.move(s.z + i, s.z + front, scratch.z + back);
        packing.move(s.index + i, s.index + front, scratch.index + back);
        const auto count = static_cast<std::size_t>(std::popcount(left));
        front += count;
        back += kLanes - count;
    }
    const unsigned left = whole < s.size ? left_of(last_group(s, whole, plane.reference)) : 0;
    for (std::size_t i = whole; i < s.size; ++i) {
        const bool is_left = (left >> (i - whole) & 1U) != 0;
        const MutableSampleSpan& to = is_left ? s : scratch;
        std::size_t& at = is_left ? front : back;
        to.x[at] = s.x[i];
        to.y[at] = s.y[i];
        to.z[at] = s.z[i];
        to.index[at] = s.index[i];
        ++at;
    }
    copy(scratch.x, back, s.x + front);
    copy(scratch.y, back, s.y + front);
    copy(scratch.z, back, s.z + front);
    copy(scratch.index, back, s.index + front);
    return front;
}

inline double sum_of(Float8 v) noexcept {
    const Float8 fours = v + __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3);
    const Float8 pairs = fours + __builtin_shufflevector(fours, fours, 2, 3, 0, 1, 6, 7, 4, 5);
    return static_cast<double>(pairs[0]) + static_cast<double>(pairs[1]);
}

SampleSums sums(const SampleSpan& s, const std::array<float, 3>& reference) noexcept {
    SampleSums total{};
    const std::size_t whole = s.size / kLanes * kLanes;
    std::size_t i = 0;
    while (i < s.size) {
        Float8 x{}, y{}, z{}, xx{}, xy{}, xz{}, yy{}, yz{}, zz{};
        const auto add = [&](const Group& g) {
            x += g.x;
            y += g.y;
            z += g.z;
            xx += g.x * g.x;
            xy += g.x * g.y;
            xz += g.x * g.z;
            yy += g.y * g.y;
            yz += g.y * g.z;
            zz += g.z * g.z;
        };
        const std::size_t end = std::min(whole, i + kLanes * kFlush);
        for (; i < end; i += kLanes) add(whole_group(s, i, reference));
        if (i == whole && i < s.size) {
            add(last_group(s, i, reference));
            i = s.size;
        }
        const std::array<Float8, 9> part = {x, y, z, xx, xy, xz, yy, yz, zz};
        for (std::size_t k = 0; k < total.size(); ++k) total[k] += sum_of(part[k]);
    }
    return total;
}

NearbyOutput nearby(const SampleSpan& samples, const float* taken, Index begin, Index end,
                    const std::array<float, 3>& center, float limit_sq,
                    const NearbyOutput& output) noexcept {
    const SampleSpan s = samples;
    const std::array<float, 3> c = center;
    NearbyOutput out = output;
    for (Index place = begin; place < end; place += kLanes) {
        const Group g = whole_group(s, place, c);
        const Float8 d = g.x * g.x + g.y * g.y + g.z * g.z;
        const unsigned here = end - place < kLanes ? (1U << (end - place)) - 1U : 255U;
        const unsigned near = lane_bits(d <= limit_sq) & here;
        const unsigned free = lane_bits(load(taken + place) <= 0.0F) & near;
        const Int8 places = Int8{0, 1, 2, 3, 4, 5, 6, 7} + static_cast<std::int32_t>(place);
        Selection{near}.store(d, out.all_sq);
        const Selection selection{free};
        selection.store(d, out.free_sq);
        selection.store(places, out.free);
        out.all_sq += std::popcount(near);
        out.free_sq += std::popcount(free);
        out.free += std::popcount(free);
    }
    return out;
}

SampleBox box(const SampleSpan& samples) noexcept {
    const SampleSpan s = samples;
    const std::array<const float*, 3> axes = {s.x, s.y, s.z};
    SampleBox result;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const float* const v = axes[axis];
        Float8 low = Float8{} + v[0], high = low;
        std::size_t i = 0;
        for (; i + kLanes <= s.size; i += kLanes) {
            const Float8 group = load(v + i);
            low = smaller(group, low);
            high = larger(group, high);
        }
        std::array<float, kLanes> lows, highs;
        __builtin_memcpy(lows.data(), &low, sizeof low);
        __builtin_memcpy(highs.data(), &high, sizeof high);
        for (std::size_t lane = 0; i < s.size; ++i, ++lane) {
            lows[lane] = std::min(lows[lane], v[i]);
            highs[lane] = std::max(highs[lane], v[i]);
        }
        result.low[axis] = *std::min_element(lows.begin(), lows.end());
        result.high[axis] = *std::max_element(highs.begin(), highs.end());
    }
    return result;
}

std::size_t count(const float* values, std::size_t size, float limit) noexcept {
    Int8 counts{};
    for (std::size_t i = 0; i < size; i += kLanes) counts -= load(values + i) <= limit;
    std::array<std::int32_t, kLanes> lanes;
    __builtin_memcpy(lanes.data(), &counts, sizeof counts);
    std::size_t total = 0;
    for (const std::int32_t lane : lanes) total += static_cast<std::size_t>(lane);
    return total;
}
