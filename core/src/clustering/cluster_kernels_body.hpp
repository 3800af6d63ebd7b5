// No header of its own: cluster_kernels.cpp includes it once for each instruction set, in a
// namespace of its own. It uses eight lanes as the compiler makes them of what the set has; only
// packing and roots are written for each.

#include "base/float_lanes_body.hpp"

constexpr std::size_t kFlush = 16;  // groups of eight summed up in floats

struct Group {
    Float8 x, y, z;
};

/// Eight samples relative to a reference.
inline Group whole_group(const SampleSpan& s, std::size_t i,
                         const std::array<float, 3>& reference) noexcept {
    return {load(s.x + i) - reference[0], load(s.y + i) - reference[1],
            load(s.z + i) - reference[2]};
}

#if defined(STIPPLE_KERNELS_AVX2)

/// The last samples, fewer than eight; the other lanes are 0.
inline Group last_group(const SampleSpan& s, std::size_t i,
                        const std::array<float, 3>& reference) noexcept {
    const Int8 lanes = {0, 1, 2, 3, 4, 5, 6, 7};
    const Int8 present = lanes < static_cast<std::int32_t>(s.size - i);
    const auto of = [&](const float* from, float origin) {
        const auto v = reinterpret_cast<Float8>(
            _mm256_maskload_ps(from + i, reinterpret_cast<__m256i>(present)));
        return reinterpret_cast<Float8>(reinterpret_cast<Int8>(v - origin) & present);
    };
    return {of(s.x, reference[0]), of(s.y, reference[1]), of(s.z, reference[2])};
}

inline unsigned lane_bits(Int8 mask) noexcept {
    return static_cast<unsigned>(_mm256_movemask_ps(reinterpret_cast<__m256>(mask)));
}

/// Eight lanes in the order that a mask says: the chosen ones first, then the others.
struct Packing {
    __m256i order;

    explicit Packing(unsigned chosen) noexcept
        : order(_mm256_cvtepu8_epi32(
              _mm_loadl_epi64(reinterpret_cast<const __m128i*>(&kPackedLanes.of[chosen])))) {}

    template <typename T>
    __m256i of(const T* from) const noexcept {
        return of_lanes(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(from)));
    }
    template <typename Lanes>
    __m256i of_lanes(Lanes lanes) const noexcept {
        return _mm256_permutevar8x32_epi32(reinterpret_cast<__m256i>(lanes), order);
    }
};

inline Double4 root_of(Double4 v) noexcept {
    return reinterpret_cast<Double4>(_mm256_sqrt_pd(reinterpret_cast<__m256d>(v)));
}

#else

/// The last samples, fewer than eight; what is missing stands at the reference, where it is 0.
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

struct Packing {
    unsigned chosen;

    template <typename T>
    std::array<T, kLanes> of(const T* from) const noexcept {
        std::array<T, kLanes + 4> v;  // each part is stored as four lanes, however few it has
        T* to = v.data();
        for (const unsigned mask : {chosen, ~chosen & 255U}) {
            store_packed(to, from, mask & 15U);
            to += std::popcount(mask & 15U);
            store_packed(to, from + 4, mask >> 4U);
            to += std::popcount(mask >> 4U);
        }
        std::array<T, kLanes> result;
        std::copy_n(v.data(), kLanes, result.data());
        return result;
    }
    template <typename Lanes>
    std::array<std::int32_t, kLanes> of_lanes(Lanes lanes) const noexcept {
        std::array<std::int32_t, kLanes> values;
        __builtin_memcpy(values.data(), &lanes, sizeof lanes);
        return of(values.data());
    }
};

inline Double4 root_of(Double4 v) noexcept {
    for (int lane = 0; lane < 4; ++lane) v[lane] = std::sqrt(v[lane]);
    return v;
}

#endif

/// Which of eight samples, relative to the plane's reference, lie left of it.
inline unsigned bits_left_of(const SplitPlane& plane, const Group& g) noexcept {
    return lane_bits(g.x * plane.normal[0] + g.y * plane.normal[1] + g.z * plane.normal[2] <
                     plane.offset);
}

/// Fewer samples than lanes, one by one.
std::size_t partition_few(const SampleSpan& s, const SplitPlane& plane,
                          const MutableSampleSpan& to) noexcept {
    const unsigned left = bits_left_of(plane, last_group(s, 0, plane.reference));
    std::size_t front = 0, back = s.size;
    for (std::size_t i = 0; i < s.size; ++i) {
        const std::size_t at = (left >> i & 1U) != 0 ? front++ : --back;
        to.x[at] = s.x[i];
        to.y[at] = s.y[i];
        to.z[at] = s.z[i];
        to.index[at] = s.index[i];
    }
    return front;
}

std::size_t partition(const SampleSpan& samples, const SplitPlane& split_plane,
                      const MutableSampleSpan& target) noexcept {
    if (samples.size < kLanes) return partition_few(samples, split_plane, target);
    // Copies that no store can reach, so that they stay in registers.
    const SampleSpan s = samples;
    const MutableSampleSpan to = target;
    const SplitPlane plane = split_plane;
    const auto each_array = [&](const auto& move) {
        move(s.x, to.x);
        move(s.y, to.y);
        move(s.z, to.z);
        move(s.index, to.index);
    };
    const auto store = [](const auto& lanes, auto* at) {
        __builtin_memcpy(at, &lanes, kLanes * sizeof *at);
    };
    // First the few that fill no group, as part of the last eight. Then as many places are free
    // before each group as there are samples to come, so the eight lanes written at either end
    // touch nothing that is to stay.
    const std::size_t few = s.size % kLanes, whole = s.size - few;
    std::size_t front = 0, back = s.size;
    if (few != 0) {
        const std::size_t i = s.size - kLanes;
        const unsigned valid = 255U << (kLanes - few) & 255U;
        const unsigned left = bits_left_of(plane, whole_group(s, i, plane.reference)) & valid;
        const Packing left_first{left}, right_last{~(valid & ~left) & 255U};
        each_array([&](const auto* from, auto* at) {
            store(right_last.of(from + i), at + i);
            store(left_first.of(from + i), at);
        });
        front = static_cast<std::size_t>(std::popcount(left));
        back -= few - front;
    }
    for (std::size_t i = 0; i < whole; i += kLanes) {
        const unsigned left = bits_left_of(plane, whole_group(s, i, plane.reference));
        const Packing left_first{left};
        each_array([&](const auto* from, auto* at) {
            const auto lanes = left_first.of(from + i);
            store(lanes, at + front);
            store(lanes, at + back - kLanes);
        });
        const auto count = static_cast<std::size_t>(std::popcount(left));
        front += count;
        back -= kLanes - count;
    }
    return front;
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
        const auto first = sums_of(x, y, z, xx), second = sums_of(xy, xz, yy, yz);
        for (std::size_t k = 0; k < 4; ++k) {
            total[k] += static_cast<double>(first[k]);
            total[4 + k] += static_cast<double>(second[k]);
        }
        total[8] += static_cast<double>(sums_of(zz, zz, zz, zz)[0]);
    }
    return total;
}

inline Double4 larger(Double4 a, Double4 b) noexcept {
    return a > b ? a : b;
}

inline Double4 size_of(Double4 v) noexcept {
    return larger(v, -v);
}

/// 1 / v, or 0 where that is not to be had.
inline Double4 inverse_of(Double4 v) noexcept {
    const Double4 inverse = 1.0 / v;
    return v > 0.0 ? inverse : Double4{};
}

/// Four symmetric matrices by their upper triangles.
struct Symmetric4 {
    Double4 xx, xy, xz, yy, yz, zz;

    Double4 largest_entry() const noexcept {
        return larger(larger(larger(size_of(xx), size_of(xy)), larger(size_of(xz), size_of(yy))),
                      larger(size_of(yz), size_of(zz)));
    }
    Symmetric4 scaled(Double4 s) const noexcept {
        return {xx * s, xy * s, xz * s, yy * s, yz * s, zz * s};
    }
    Symmetric4 minus_identity(Double4 s) const noexcept {
        return {xx - s, xy, xz, yy - s, yz, zz - s};
    }
};

struct Extremes {
    Double4 smallest, largest;
};

/// The extreme eigenvalues: the characteristic polynomial of the matrix without its mean, of size
/// one, is y^3 - 3 y - 2 r. Of its roots the one farthest from zero is found by Newton's iteration,
/// which three steps end at full accuracy, and the other two follow from it.
inline Extremes extreme_eigenvalues(const Symmetric4& a) noexcept {
    const Double4 mean = (a.xx + a.yy + a.zz) / 3.0;
    const Symmetric4 d = a.minus_identity(mean);
    const Double4 off = d.xy * d.xy + d.xz * d.xz + d.yz * d.yz;
    const Double4 spread = root_of((d.xx * d.xx + d.yy * d.yy + d.zz * d.zz + 2.0 * off) / 6.0);
    const Double4 determinant = d.xx * (d.yy * d.zz - d.yz * d.yz) -
                                d.xy * (d.xy * d.zz - d.yz * d.xz) +
                                d.xz * (d.xy * d.yz - d.yy * d.xz);
    const Double4 by = inverse_of(spread);
    const Double4 r = 0.5 * determinant * by * by * by;
    const Double4 size = size_of(r), q = size < 1.0 ? size : Double4{} + 1.0;
    Double4 y = 1.7320508075688772 + q * (1.0 / 3.0 - 0.0653841409022105 * q);
    for (int step = 0; step < 3; ++step) y -= (y * (y * y - 3.0) - 2.0 * q) / (3.0 * y * y - 3.0);
    const Double4 apart = root_of(larger(12.0 - 3.0 * y * y, Double4{}));
    const Double4 other = 0.5 * (y + apart);  // of the opposite sign
    return {mean - spread * (r < 0.0 ? y : other), mean + spread * (r < 0.0 ? other : y)};
}

struct Vector4 {
    Double4 x, y, z;

    Double4 length_sq() const noexcept { return x * x + y * y + z * z; }
};

inline Vector4 cross(const Vector4& a, const Vector4& b) noexcept {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

inline void keep_longer(Vector4& v, Double4& length_sq, const Vector4& other) noexcept {
    const Double4 other_sq = other.length_sq();
    const auto is_longer = other_sq > length_sq;
    v = {is_longer ? other.x : v.x, is_longer ? other.y : v.y, is_longer ? other.z : v.z};
    length_sq = is_longer ? other_sq : length_sq;
}

std::array<Spread, kSpreads> spreads(const std::array<Symmetric3, kSpreads>& m) noexcept {
    const Symmetric4 all = {
        {m[0].xx, m[1].xx, m[2].xx, m[3].xx}, {m[0].xy, m[1].xy, m[2].xy, m[3].xy},
        {m[0].xz, m[1].xz, m[2].xz, m[3].xz}, {m[0].yy, m[1].yy, m[2].yy, m[3].yy},
        {m[0].yz, m[1].yz, m[2].yz, m[3].yz}, {m[0].zz, m[1].zz, m[2].zz, m[3].zz}};
    const Double4 scale = all.largest_entry();
    const Symmetric4 a = all.scaled(inverse_of(scale));
    const Extremes values = extreme_eigenvalues(a);
    // The rows of A - lambda span what is orthogonal to the eigenvector.
    Symmetric4 shifted = a.minus_identity(values.largest);
    shifted = shifted.scaled(inverse_of(shifted.largest_entry()));
    const Vector4 row0 = {shifted.xx, shifted.xy, shifted.xz},
                  row1 = {shifted.xy, shifted.yy, shifted.yz},
                  row2 = {shifted.xz, shifted.yz, shifted.zz};
    Vector4 v = cross(row0, row1);
    Double4 length_sq = v.length_sq();
    keep_longer(v, length_sq, cross(row1, row2));
    keep_longer(v, length_sq, cross(row2, row0));
    const Double4 by = inverse_of(root_of(length_sq));
    const Double4 smallest = values.smallest * scale, largest = values.largest * scale;

    constexpr double kParallel = 1e-20;
    std::array<Spread, kSpreads> result;
    for (std::size_t i = 0; i < kSpreads; ++i) {
        result[i].smallest = smallest[i];
        result[i].largest = largest[i];
        result[i].direction = length_sq[i] > kParallel
                                  ? Vec3d(v.x[i] * by[i], v.y[i] * by[i], v.z[i] * by[i])
                                  : eigenvector(m[i], largest[i]);
    }
    return result;
}

inline Float8 larger(Float8 a, Float8 b) noexcept {
    return a > b ? a : b;
}

unsigned boxes_within(const EightBoxes& boxes, const std::array<float, 3>& center,
                      float radius_sq) noexcept {
    Float8 distance_sq{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const Float8 below = load(boxes.low[axis].data()) - center[axis],
                     above = center[axis] - load(boxes.high[axis].data());
        const Float8 gap = larger(larger(below, above), Float8{});
        distance_sq += gap * gap;
    }
    return lane_bits(distance_sq <= radius_sq);
}

NearbyOutput nearby(const SampleBlocks& blocks, const Index* groups, std::size_t count,
                    const NearbyQuery& query, const NearbyOutput& output) noexcept {
    // Copies that no store can reach, so that they stay in registers.
    const SampleBlocks b = blocks;
    const NearbyQuery q = query;
    NearbyOutput out = output;
    const auto store = [](const auto& lanes, auto* to) {
        __builtin_memcpy(to, &lanes, sizeof lanes);
    };
    const auto add = [&](Index place, unsigned here) {
        const Group g = whole_group(b.samples, place, q.center);
        const Float8 d = g.x * g.x + g.y * g.y + g.z * g.z;
        const unsigned counted = lane_bits(d <= q.counted_sq) & here;
        const unsigned free = lane_bits((d <= q.limit_sq) & (load(b.taken + place) <= 0.0F)) & here;
        const Int8 places = Int8{0, 1, 2, 3, 4, 5, 6, 7} + static_cast<std::int32_t>(place);
        const Packing free_first{free};
        store(Packing{counted}.of_lanes(d), out.all_sq);
        store(free_first.of_lanes(d), out.free_sq);
        store(free_first.of_lanes(places), out.free);
        out.all_sq += std::popcount(counted);
        out.free_sq += std::popcount(free);
        out.free += std::popcount(free);
    };
    for (std::size_t g = 0; g < count; ++g) {
        for (unsigned near = boxes_within(b.boxes[groups[g]], q.center, q.limit_sq); near != 0;
             near &= near - 1) {
            const std::size_t block =
                8 * groups[g] + static_cast<std::size_t>(std::countr_zero(near));
            const Index begin = b.begins[block], end = b.begins[block + 1];
            if (begin < q.begin || end > q.end) {
                out.is_beyond = true;
                return out;
            }
            const Index few = (end - begin) % kLanes, whole = end - few;
            for (Index place = begin; place < whole; place += kLanes) add(place, 255U);
            if (few != 0) add(whole, (1U << few) - 1U);
        }
        const auto found = (out.all_sq - output.all_sq) + (out.free_sq - output.free_sq);
        if (static_cast<std::size_t>(found) > q.at_most) break;
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
            low = group < low ? group : low;
            high = group > high ? group : high;
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

/// Writes the items beside the values in (low, high], packed.
template <typename T>
std::size_t items_between(const float* values, const T* items, std::size_t size, float low,
                          float high, T* out) noexcept {
    std::size_t total = 0;
    for (std::size_t i = 0; i < size; i += kLanes) {
        const Float8 v = load(values + i);
        const unsigned chosen = lane_bits((v > low) & (v <= high));
        const auto packed = Packing{chosen}.of(items + i);
        __builtin_memcpy(out + total, &packed, sizeof packed);
        total += static_cast<std::size_t>(std::popcount(chosen));
    }
    return total;
}

std::size_t values_between(const float* values, std::size_t size, float low, float high,
                           float* out) noexcept {
    return items_between(values, values, size, low, high, out);
}

std::size_t places_between(const float* values, const Index* places, std::size_t size, float low,
                           float high, Index* out) noexcept {
    return items_between(values, places, size, low, high, out);
}
