// No header of its own: nearest_kernels.cpp includes it once for each instruction set, in a
// namespace of its own. It uses eight lanes as the compiler makes them of what the set has; only
// packing is written for each.

using Float8 = float __attribute__((vector_size(32)));
using Int8 = std::int32_t __attribute__((vector_size(32)));

constexpr std::uint32_t kLanes = 8;

[[gnu::always_inline]] inline Float8 load(const float* from) noexcept {
    Float8 v;
    __builtin_memcpy(&v, from, sizeof v);
    return v;
}
[[gnu::always_inline]] inline Int8 load(const std::uint32_t* from) noexcept {
    Int8 v;
    __builtin_memcpy(&v, from, sizeof v);
    return v;
}
inline void store(float* to, Float8 v) noexcept {
    __builtin_memcpy(to, &v, sizeof v);
}
inline void store(std::uint32_t* to, Int8 v) noexcept {
    __builtin_memcpy(to, &v, sizeof v);
}

[[gnu::always_inline]] inline Float8 larger(Float8 a, Float8 b) noexcept {
    return a > b ? a : b;
}

/// Puts the lesser of each pair into `a`, the larger into `b`. (Of `?:` compilers make a comparison
/// and a choice, since they must mind numbers that are none.)
[[gnu::always_inline]] inline void sort(Float8& a, Float8& b) noexcept {
#if defined(STIPPLE_KERNELS_AVX2)
    const __m256 v = reinterpret_cast<__m256>(a), w = reinterpret_cast<__m256>(b);
    a = reinterpret_cast<Float8>(_mm256_min_ps(v, w));
    b = reinterpret_cast<Float8>(_mm256_max_ps(v, w));
#elif defined(__SSE2__)
    __m128 v[2], w[2];
    __builtin_memcpy(v, &a, sizeof v);
    __builtin_memcpy(w, &b, sizeof w);
    for (int half = 0; half < 2; ++half) {
        const __m128 lesser = _mm_min_ps(v[half], w[half]);
        w[half] = _mm_max_ps(v[half], w[half]);
        v[half] = lesser;
    }
    __builtin_memcpy(&a, v, sizeof v);
    __builtin_memcpy(&b, w, sizeof w);
#else
    const Float8 lesser = a < b ? a : b;
    b = larger(a, b);
    a = lesser;
#endif
}

inline std::uint32_t sum_of(Int8 v) noexcept {
    const Int8 fours = v + __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3);
    const Int8 pairs = fours + __builtin_shufflevector(fours, fours, 2, 3, 0, 1, 6, 7, 4, 5);
    return static_cast<std::uint32_t>(pairs[0] + pairs[1]);
}

#if defined(STIPPLE_KERNELS_AVX2)

inline std::uint32_t lane_bits(Int8 mask) noexcept {
    return static_cast<std::uint32_t>(_mm256_movemask_ps(reinterpret_cast<__m256>(mask)));
}

/// The chosen lanes, packed to the front; behind them anything.
struct Packing {
    __m256i order;

    explicit Packing(std::uint32_t mask) noexcept
        : order(_mm256_cvtepu8_epi32(
              _mm_loadl_epi64(reinterpret_cast<const __m128i*>(&kPackedLanes.of[mask])))) {}

    void store(Int8 v, std::uint32_t* to) const noexcept {
        const __m256i packed = _mm256_permutevar8x32_epi32(reinterpret_cast<__m256i>(v), order);
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), packed);
    }
    void store(Float8 v, float* to) const noexcept {
        const __m256 packed = _mm256_permutevar8x32_ps(reinterpret_cast<__m256>(v), order);
        _mm256_storeu_ps(to, packed);
    }
};

#else

inline std::uint32_t lane_bits(Int8 mask) noexcept {
    std::uint32_t bits = 0;
    for (unsigned half = 0; half < 2; ++half) {
        Int4 part;
        __builtin_memcpy(&part, reinterpret_cast<const char*>(&mask) + 16 * half, 16);
        bits |= stipple::lane_bits(part) << (4 * half);
    }
    return bits;
}

struct Packing {
    std::uint32_t mask;

    template <typename V, typename T>
    void store(V v, T* to) const noexcept {
        alignas(32) T lanes[kLanes];
        __builtin_memcpy(lanes, &v, sizeof lanes);
        store_packed(to, lanes, mask & 15U);
        store_packed(to + __builtin_popcount(mask & 15U), lanes + 4, mask >> 4U);
    }
};

#endif

/// How far a box is from eight others along an axis; 0 where they overlap.
[[gnu::always_inline]] inline Float8 gap(float low, float high, const float* lows,
                                         const float* highs) noexcept {
    return larger(larger(load(lows) - high, low - load(highs)), Float8{});
}

/// The children of a node within a distance of a box, as bits. Their distance is never above that
/// of two points in the boxes: each difference is no larger, and rounding keeps order.
inline std::uint32_t near_children(const PointTree::Node& node, const float* low, const float* high,
                                   float limit_sq) noexcept {
    const float* const lows = reinterpret_cast<const float*>(&node.low);
    const float* const highs = reinterpret_cast<const float*>(&node.high);
    const Float8 x = gap(low[0], high[0], lows, highs);
    const Float8 y = gap(low[1], high[1], lows + kLanes, highs + kLanes);
    const Float8 z = gap(low[2], high[2], lows + 2 * kLanes, highs + 2 * kLanes);
    return lane_bits(x * x + y * y + z * z <= limit_sq);
}

/// Calls visit(number) for the leaves within a distance of a box, in the order of the tree, until
/// one answers false: of any number.
template <typename Visit>
[[gnu::always_inline]] inline bool each_of_many_leaves(const PointTree::View& tree,
                                                       const float* low, const float* high,
                                                       float limit_sq, Visit&& visit) noexcept {
    // Depth first: of each level the node that is open, and its children still to be visited.
    constexpr unsigned kDepth = 12;
    std::uint32_t node[kDepth], open[kDepth];
    std::uint32_t level = tree.level_count - 1;
    node[level] = 0;
    open[level] = near_children(tree.levels[level][0], low, high, limit_sq);
    while (true) {
        if (open[level] == 0) {
            if (++level == tree.level_count) return true;
            continue;
        }
        const std::uint32_t child =
            node[level] * kLanes + static_cast<std::uint32_t>(__builtin_ctz(open[level]));
        open[level] &= open[level] - 1;
        if (level > 0) {
            --level;
            node[level] = child;
            open[level] = near_children(tree.levels[level][child], low, high, limit_sq);
            continue;
        }
        if (!visit(child)) return false;
    }
}

/// The same, level by level where they are few: no branch depends on which children are near, and
/// nobody could foretell it.
template <typename Visit>
[[gnu::always_inline]] inline bool each_leaf(const PointTree::View& tree, const float* low,
                                             const float* high, float limit_sq,
                                             Visit&& visit) noexcept {
    constexpr std::uint32_t kFew = 128;
    std::uint32_t numbers[2][kFew + kLanes];
    std::uint32_t *here = numbers[0], *below = numbers[1];
    std::uint32_t count = 1;
    here[0] = 0;
    for (std::uint32_t level = tree.level_count; level-- > 0;) {
        std::uint32_t children = 0;
        for (std::uint32_t i = 0; i < count; ++i) {
            if (children > kFew) return each_of_many_leaves(tree, low, high, limit_sq, visit);
            const std::uint32_t near =
                near_children(tree.levels[level][here[i]], low, high, limit_sq);
            const auto first = static_cast<std::int32_t>(here[i] * kLanes);
            Packing{near}.store(Int8{0, 1, 2, 3, 4, 5, 6, 7} + first, below + children);
            children += static_cast<std::uint32_t>(__builtin_popcount(near));
        }
        count = children;
        std::uint32_t* const done = here;
        here = below;
        below = done;
    }
    for (std::uint32_t i = 0; i < count; ++i)
        if (!visit(here[i])) return false;
    return true;
}

bool gather(const PointTree::View& tree, const float* low, const float* high, float limit_sq,
            Candidates& candidates) noexcept {
    std::uint32_t count = 0;
    const bool all = each_leaf(tree, low, high, limit_sq, [&](std::uint32_t number) {
        if (count == candidates.capacity) return false;
        const PointTree::Leaf& leaf = tree.leaves[number];
        const std::uint32_t at = count * kLanes;
        store(candidates.x + at, load(reinterpret_cast<const float*>(&leaf.x)));
        store(candidates.y + at, load(reinterpret_cast<const float*>(&leaf.y)));
        store(candidates.z + at, load(reinterpret_cast<const float*>(&leaf.z)));
        store(candidates.index + at, load(reinterpret_cast<const Index*>(&leaf.index)));
        candidates.leaf[count++] = number;
        return true;
    });
    if (!all) return false;
    candidates.leaves = count;
    candidates.limit_sq = limit_sq;
    return true;
}

/// Where a stretch of candidates is measured from, and those that were near enough.
struct Measure {
    const float *x, *y, *z;
    float* distance_sq;  ///< of all
    float qx, qy, qz, radius_sq;
    float* taken_sq;  ///< of those taken, packed
    std::uint32_t* taken_slot;
    std::uint32_t count = 0;

    [[gnu::always_inline]] Float8 at(std::uint32_t i) const noexcept {
        const Float8 dx = load(x + i) - qx, dy = load(y + i) - qy, dz = load(z + i) - qz;
        return dx * dx + dy * dy + dz * dz;
    }
    [[gnu::always_inline]] void take(Float8 d, std::uint32_t i) noexcept {
        const std::uint32_t within = lane_bits(d <= radius_sq);
        const Packing packing{within};
        packing.store(d, taken_sq + count);
        packing.store(Int8{0, 1, 2, 3, 4, 5, 6, 7} + static_cast<std::int32_t>(i),
                      taken_slot + count);
        count += static_cast<std::uint32_t>(__builtin_popcount(within));
    }
    [[gnu::always_inline]] void measure_and_take(std::uint32_t begin, std::uint32_t end) noexcept {
        for (std::uint32_t i = begin; i < end; i += kLanes) {
            const Float8 d = at(i);
            store(distance_sq + i, d);
            take(d, i);
        }
    }
};

inline std::uint32_t count_within(const Candidates& c, float radius_sq) noexcept {
    Int8 minus{};
    for (std::uint32_t i = 0; i < c.leaves * kLanes; i += kLanes)
        minus += load(c.distance_sq + i) <= radius_sq;
    return -sum_of(minus);
}

/// The least squared distance that is not 0.
inline float least_above_zero(const Candidates& c) noexcept {
    const Float8 infinite = Float8{} + __builtin_inff();
    Float8 least = infinite;
    for (std::uint32_t i = 0; i < c.leaves * kLanes; i += kLanes) {
        const Float8 d = load(c.distance_sq + i);
        const Float8 above = d > 0.0F ? d : infinite;
        least = above < least ? above : least;
    }
    float result = least[0];
    for (std::uint32_t lane = 1; lane < kLanes; ++lane)
        result = least[lane] < result ? least[lane] : result;
    return result;
}

/// A squared distance within which there are `least` to `most` candidates, `n` being within `at`;
/// more where several are equally far or the tries were used up. Negative where there are fewer
/// than `least` within the limit.
inline float find_radius_sq(const Candidates& c, std::uint32_t least, std::uint32_t most, float at,
                            std::uint32_t n) noexcept {
    constexpr unsigned kTries = 16;
    const float wanted = 0.5F * static_cast<float>(least + most);
    float low = 0, high = c.limit_sq;
    float low_count = 0, high_count = -1;  // none is known yet
    for (unsigned i = 0; i < kTries; ++i) {
        if (n < least) {
            if (!(at < c.limit_sq)) return -1.0F;
            low = at;
            low_count = static_cast<float>(n);
        } else {
            high = at;
            high_count = static_cast<float>(n);
        }
        // On a surface the number grows as the squared distance does. Where it does not, far
        // points keep that from closing in: halved by turns, by order of magnitude.
        if (high_count < 0)
            at = !(at > 0) ? least_above_zero(c) : at * (wanted + 0.5F) / (low_count + 0.5F);
        else if (i % 2 == 0)
            at = low + (high - low) * (wanted - low_count) / (high_count - low_count);
        else
            at = low > 0 ? __builtin_sqrtf(low) * __builtin_sqrtf(high) : high * 0x1p-6F;
        if (!(at < c.limit_sq)) at = c.limit_sq;
        if (high_count >= 0 && !(at > low && at < high)) break;
        n = count_within(c, at);
        if (n >= least && n <= most) return at;
    }
    if (high_count >= 0) return high;
    return count_within(c, c.limit_sq) >= least ? c.limit_sq : -1.0F;
}

void choose(const Candidates& candidates, const float* from, std::uint32_t own, std::uint32_t k,
            std::uint32_t slack, float guess_sq, Chosen& chosen) noexcept {
    const Candidates c = candidates;  // a copy that no store can reach
    const std::uint32_t end = c.leaves * kLanes;
    const std::uint32_t home = own < end ? own / kLanes * kLanes : end;
    Measure m = {c.x,
                 c.y,
                 c.z,
                 c.distance_sq,
                 from[0],
                 from[1],
                 from[2],
                 guess_sq < c.limit_sq ? guess_sq : c.limit_sq,
                 chosen.distance_sq,
                 chosen.slot};
    m.measure_and_take(0, home);
    if (home < end) {
        const Int8 is_own = Int8{0, 1, 2, 3, 4, 5, 6, 7} == static_cast<std::int32_t>(own % kLanes);
        const Float8 d = is_own ? Float8{} + __builtin_inff() : m.at(home);
        store(c.distance_sq + home, d);
        m.take(d, home);
        m.measure_and_take(home + kLanes, end);
    }

    if (m.count < k || m.count > k + slack) {
        m.radius_sq = find_radius_sq(c, k, k + slack, m.radius_sq, m.count);
        m.count = 0;
        if (m.radius_sq >= 0) {
            for (std::uint32_t i = 0; i < end; i += kLanes) m.take(load(c.distance_sq + i), i);
        }
    }
    chosen.count = m.count;
    chosen.radius_sq = m.radius_sq;
}

/// Ranks those chosen by how many of the others are nearer. Quadratic, but without a branch that
/// could be mispredicted.
inline void count_nearer(const Chosen& c) noexcept {
    for (std::uint32_t i = 0; i < c.count; i += 3 * kLanes) {
        Int8 minus[3] = {};
        for (std::uint32_t j = 0; j < c.count; ++j) {
            for (std::uint32_t g = 0; g < 3; ++g)
                minus[g] += c.distance_sq[j] < load(c.distance_sq + i + g * kLanes);
        }
        for (std::uint32_t g = 0; g < 3; ++g) store(c.rank + i + g * kLanes, -minus[g]);
    }
}

/// Adds to the ranks how many of the others are equally far and stand before it in number.
inline void count_equals(const Candidates& candidates, const Chosen& c) noexcept {
    constexpr std::uint32_t kFlip = 0x80000000U;  // compares as without a sign
    for (std::uint32_t i = 0; i < c.count; ++i) c.flipped[i] = candidates.index[c.slot[i]] ^ kFlip;
    for (std::uint32_t i = 0; i < c.count; i += 3 * kLanes) {
        Int8 minus[3] = {};
        for (std::uint32_t j = 0; j < c.count; ++j) {
            const auto index = static_cast<std::int32_t>(c.flipped[j]);
            for (std::uint32_t g = 0; g < 3; ++g) {
                const std::uint32_t at = i + g * kLanes;
                minus[g] +=
                    (c.distance_sq[j] == load(c.distance_sq + at)) & (index < load(c.flipped + at));
            }
        }
        for (std::uint32_t g = 0; g < 3; ++g) {
            std::uint32_t* const to = c.rank + i + g * kLanes;
            store(to, load(to) - minus[g]);
        }
    }
}

void rank(const Candidates& candidates, const Chosen& chosen) noexcept {
    const Chosen c = chosen;
    const std::uint32_t groups = (c.count + 3 * kLanes - 1) / (3 * kLanes) * 3;
    const Float8 infinite = Float8{} + __builtin_inff();
    for (std::uint32_t g = 0; g < 3; ++g) store(c.distance_sq + c.count + g * kLanes, infinite);

    count_nearer(c);
    Int8 sum{};
    for (std::uint32_t g = 0; g < groups; ++g) sum += load(c.rank + g * kLanes);
    const std::uint32_t without_equals =
        c.count * (c.count - 1) / 2 + (groups * kLanes - c.count) * c.count;
    if (sum_of(sum) != without_equals) count_equals(candidates, c);
}

#include "neighbors/place_kernels_body.hpp"

/// Eight lists of eight numbers, each in a lane; sorted by comparisons in pairs (K. Batcher 1968).
struct Lists {
    Float8 v[8];

    [[gnu::always_inline]] void sort_all() noexcept {
        for (const int i : {0, 2, 4, 6}) sort(v[i], v[i + 1]);
        for (const int i : {0, 1, 4, 5}) sort(v[i], v[i + 2]);
        for (const int i : {1, 5}) sort(v[i], v[i + 1]);
        for (const int i : {0, 1, 2, 3}) sort(v[i], v[i + 4]);
        for (const int i : {2, 3}) sort(v[i], v[i + 2]);
        for (const int i : {1, 3, 5}) sort(v[i], v[i + 1]);
    }
    /// The lesser eight of these and as many others, both sorted; sorted.
    [[gnu::always_inline]] void take(Lists& others) noexcept {
        for (int i = 0; i < 8; ++i) sort(v[i], others.v[7 - i]);
        for (const int i : {0, 1, 2, 3}) sort(v[i], v[i + 4]);
        for (const int i : {0, 1, 4, 5}) sort(v[i], v[i + 2]);
        for (const int i : {0, 2, 4, 6}) sort(v[i], v[i + 1]);
    }
};

/// From the points of a leaf, each in its lane, to those of another.
[[gnu::always_inline]] inline Lists distances_sq(const PointTree::Leaf& from,
                                                 const PointTree::Leaf& to) noexcept {
    const Float8 x = load(reinterpret_cast<const float*>(&from.x)),
                 y = load(reinterpret_cast<const float*>(&from.y)),
                 z = load(reinterpret_cast<const float*>(&from.z));
    const float* const to_x = reinterpret_cast<const float*>(&to.x);
    const float* const to_y = reinterpret_cast<const float*>(&to.y);
    const float* const to_z = reinterpret_cast<const float*>(&to.z);
    Lists lists;
    for (std::uint32_t i = 0; i < kLanes; ++i) {
        const Float8 dx = x - to_x[i], dy = y - to_y[i], dz = z - to_z[i];
        lists.v[i] = dx * dx + dy * dy + dz * dz;
    }
    return lists;
}

void spread(const PointTree::View& tree, std::uint32_t leaf, float* spreads) noexcept {
    constexpr std::uint32_t kLeaves = 3;
    constexpr float kInfinity = __builtin_inff();
    const std::uint32_t all = tree.child_counts[0];
    const std::uint32_t before = leaf > 0 ? leaf - 1 : 0;
    const std::uint32_t first = before + kLeaves <= all ? before
                                : all > kLeaves         ? all - kLeaves
                                                        : 0;
    const std::uint32_t end = first + kLeaves < all ? first + kLeaves : all;
    const PointTree::Leaf& own = tree.leaves[leaf];
    Lists nearest = distances_sq(own, own);
    for (std::uint32_t i = 0; i < kLanes; ++i) {
        alignas(32) float own_place[kLanes] = {};
        own_place[i] = kInfinity;
        nearest.v[i] += load(own_place);
    }
    nearest.sort_all();
    for (std::uint32_t l = first; l < end; ++l) {
        if (l == leaf) continue;
        Lists more = distances_sq(own, tree.leaves[l]);
        more.sort_all();
        nearest.take(more);
    }
    Float8 sum{};
    for (const Float8& d : nearest.v) sum += d < kInfinity ? d : Float8{};
    store(spreads, sum * (1.0F / kLanes));
}
