// No header of its own: part of nearest_kernels_body.hpp, once for each instruction set. What is near
// a place that need be none of the points.

/// Squared distances of eight points to q.
[[gnu::always_inline]] inline Float8 leaf_distances_sq(const PointTree::Leaf& leaf,
                                                       const float* q) noexcept {
    const Float8 dx = load(reinterpret_cast<const float*>(&leaf.x)) - q[0];
    const Float8 dy = load(reinterpret_cast<const float*>(&leaf.y)) - q[1];
    const Float8 dz = load(reinterpret_cast<const float*>(&leaf.z)) - q[2];
    return dx * dx + dy * dy + dz * dz;
}

std::uint32_t within(const PointTree::View& tree, const float* q, float radius_sq,
                     std::uint32_t most, float* distances_sq, Index* indices) noexcept {
    std::uint32_t count = 0;
    each_leaf(tree, q, q, radius_sq, [&](std::uint32_t number) {
        const PointTree::Leaf& leaf = tree.leaves[number];
        const Float8 d = leaf_distances_sq(leaf, q);
        const std::uint32_t near = lane_bits(d <= radius_sq);
        const Packing packing{near};
        packing.store(d, distances_sq + count);
        packing.store(load(reinterpret_cast<const Index*>(&leaf.index)), indices + count);
        count += static_cast<std::uint32_t>(__builtin_popcount(near));
        return count <= most;
    });
    return count;
}

std::uint32_t around(const PointTree::View& tree, const float* q, float radius_sq,
                     std::uint32_t most, float* x, float* y, float* z) noexcept {
    std::uint32_t count = 0;
    each_leaf(tree, q, q, radius_sq, [&](std::uint32_t number) {
        const PointTree::Leaf& leaf = tree.leaves[number];
        const Float8 dx = load(reinterpret_cast<const float*>(&leaf.x)) - q[0];
        const Float8 dy = load(reinterpret_cast<const float*>(&leaf.y)) - q[1];
        const Float8 dz = load(reinterpret_cast<const float*>(&leaf.z)) - q[2];
        const std::uint32_t near = lane_bits(dx * dx + dy * dy + dz * dz <= radius_sq);
        const Packing packing{near};
        packing.store(dx, x + count);
        packing.store(dy, y + count);
        packing.store(dz, z + count);
        count += static_cast<std::uint32_t>(__builtin_popcount(near));
        return count <= most;
    });
    return count;
}

/// Squared distances of the children of a node to q, 0 inside.
[[gnu::always_inline]] inline Float8 child_distances_sq(const PointTree::Node& node,
                                                        const float* q) noexcept {
    const float* const lows = reinterpret_cast<const float*>(&node.low);
    const float* const highs = reinterpret_cast<const float*>(&node.high);
    const Float8 x = gap(q[0], q[0], lows, highs);
    const Float8 y = gap(q[1], q[1], lows + kLanes, highs + kLanes);
    const Float8 z = gap(q[2], q[2], lows + 2 * kLanes, highs + 2 * kLanes);
    return x * x + y * y + z * z;
}

/// Eight distances in order, by one number each: the bits of the distance, which are in the order
/// of what they stand for, but for the last three, which tell the lane.
struct LaneQueue {
    static constexpr std::int32_t kLaneBits = 7, kTaken = 0x7FFFFFFF;
    Int8 keys;

    [[gnu::always_inline]] static Int8 of(Float8 d) noexcept {
        return (reinterpret_cast<Int8>(d) & ~kLaneBits) | Int8{0, 1, 2, 3, 4, 5, 6, 7};
    }
    /// No distance up to the limit has a greater key.
    [[gnu::always_inline]] static std::int32_t limit_of(float limit_sq) noexcept {
        std::int32_t bits;
        __builtin_memcpy(&bits, &limit_sq, sizeof bits);
        return bits | kLaneBits;
    }
    [[gnu::always_inline]] static Int8 smaller(Int8 a, Int8 b) noexcept { return a < b ? a : b; }
    /// The least key, which is taken out; its last bits are the lane.
    [[gnu::always_inline]] std::int32_t least() const noexcept {
        Int8 m = smaller(keys, __builtin_shufflevector(keys, keys, 4, 5, 6, 7, 0, 1, 2, 3));
        m = smaller(m, __builtin_shufflevector(m, m, 2, 3, 0, 1, 6, 7, 4, 5));
        m = smaller(m, __builtin_shufflevector(m, m, 1, 0, 3, 2, 5, 4, 7, 6));
        return m[0];
    }
    [[gnu::always_inline]] void take(std::int32_t key) noexcept {
        keys = keys == key ? Int8{} + kTaken : keys;
    }
};

/// The nearest so far, in order. Distance and index are one number, in the order of both.
struct Ranking {
    using Long4 = std::int64_t __attribute__((vector_size(32)));
    static constexpr std::uint32_t kFours = 4;

    std::int64_t* key;  ///< one before them is lower than any
    std::uint32_t k;
    float limit_sq = kFarthest;
    static constexpr float kFarthest = std::numeric_limits<float>::max();

    Ranking(std::int64_t* keys, std::uint32_t count) noexcept : key(keys), k(count) {
        key[-1] = -1;
        for (std::uint32_t i = 0; i < k + kFours - 1; ++i)
            key[i] = key_of(kFarthest, PointTree::kNone);
    }
    [[gnu::always_inline]] static std::int64_t key_of(float distance_sq, Index index) noexcept {
        std::uint32_t bits;
        __builtin_memcpy(&bits, &distance_sq, sizeof bits);
        return static_cast<std::int64_t>(std::uint64_t{bits} << 32U | index);
    }
    /// Moves those behind it up by one place, without a branch that could be mispredicted.
    [[gnu::always_inline]] void add(std::int64_t candidate) noexcept {
        for (std::uint32_t at = (k - 1) / kFours * kFours + kFours; at != 0;) {
            at -= kFours;
            Long4 here, before;
            __builtin_memcpy(&here, key + at, sizeof here);
            __builtin_memcpy(&before, key + at - 1, sizeof before);
            const Long4 least = here < candidate ? here : Long4{} + candidate;
            here = before > least ? before : least;
            __builtin_memcpy(key + at, &here, sizeof here);
        }
        const auto bits = static_cast<std::uint32_t>(key[k - 1] >> 32U);
        __builtin_memcpy(&limit_sq, &bits, sizeof bits);
    }
};

/// Whether a child of a node has points that are nearer than one of those found, or as near and of
/// a lower number: from afar, and in a crowd in one place, most points are equally far.
inline bool may_add_to(const Ranking& found, const PointTree::Node& node, std::uint32_t lane,
                       const float* q) noexcept {
    const float* const lows = reinterpret_cast<const float*>(&node.low) + lane;
    const float* const highs = reinterpret_cast<const float*>(&node.high) + lane;
    float gaps[3];
    for (std::uint32_t axis = 0; axis < 3; ++axis) {
        const float below = lows[axis * kLanes] - q[axis], above = q[axis] - highs[axis * kLanes];
        const float outside = below > above ? below : above;
        gaps[axis] = outside > 0 ? outside : 0;
    }
    const float distance_sq = gaps[0] * gaps[0] + gaps[1] * gaps[1] + gaps[2] * gaps[2];
    const Index lowest = reinterpret_cast<const Index*>(&node.lowest)[lane];
    return Ranking::key_of(distance_sq, lowest) <= found.key[found.k - 1];
}

bool nearest(const PointTree::View& tree, const float* q, std::uint32_t k,
             std::int64_t* keys) noexcept {
    Ranking found(keys, k);
    // Depth first, the nearest child first: of each level the node that is open, and its children
    // still to be visited.
    constexpr unsigned kDepth = 12;
    std::uint32_t node[kDepth];
    LaneQueue open[kDepth];
    std::uint32_t level = tree.level_count - 1;
    node[level] = 0;
    open[level] = {LaneQueue::of(child_distances_sq(tree.levels[level][0], q))};
    while (true) {
        const std::int32_t next = open[level].least();
        if (next > LaneQueue::limit_of(found.limit_sq)) {
            if (++level == tree.level_count) break;
            continue;
        }
        open[level].take(next);
        const auto lane = static_cast<std::uint32_t>(next & LaneQueue::kLaneBits);
        const bool may_tie = (next | LaneQueue::kLaneBits) == LaneQueue::limit_of(found.limit_sq);
        if (may_tie && !may_add_to(found, tree.levels[level][node[level]], lane, q)) continue;
        const std::uint32_t child = node[level] * kLanes + lane;
        if (level > 0) {
            node[--level] = child;
            open[level] = {LaneQueue::of(child_distances_sq(tree.levels[level][child], q))};
            continue;
        }
        const PointTree::Leaf& leaf = tree.leaves[child];
        const Index* const index = reinterpret_cast<const Index*>(&leaf.index);
        const Float8 d = leaf_distances_sq(leaf, q);
        LaneQueue points = {LaneQueue::of(d)};
        for (std::int32_t point = points.least(); point <= LaneQueue::limit_of(found.limit_sq);
             point = points.least()) {
            const auto at = static_cast<std::uint32_t>(point & LaneQueue::kLaneBits);
            found.add(Ranking::key_of(d[at], index[at]));
            points.take(point);
        }
    }
    return static_cast<Index>(keys[k - 1]) != PointTree::kNone;
}
