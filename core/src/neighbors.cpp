#include "stipple/neighbors.hpp"

#include "float4.hpp"
#include "hilbert_order.hpp"
#include "parallel_for.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>

// Follows: Kamel and Faloutsos 1994 (the packed Hilbert R-tree). Points are sorted along a Hilbert
// curve and cut into leaves of 16, whose coordinates lie together for vector code. All points of a
// leaf ask at once: their own stretch of the curve gives each a first list, the longest of the
// radii gives the leaves that can still matter, and those are looked through.

namespace stipple {

namespace {

constexpr std::size_t kLeaf = 16;
constexpr std::size_t kFanOut = 8;
constexpr std::size_t kLeavesPerBlock = 64;
constexpr std::size_t kTidied = 1024;  // points of the curve that are ordered anew

struct Box {
    Vec3f low = Vec3f::Constant(std::numeric_limits<float>::infinity());
    Vec3f high = Vec3f::Constant(-std::numeric_limits<float>::infinity());

    void add(const Box& other) noexcept {
        low = low.cwiseMin(other.low);
        high = high.cwiseMax(other.high);
    }
    /// Squared distance to a box; 0 when they touch. Never above that of two points in them as
    /// `distances_sq` rounds it: each difference is no larger, and rounding keeps order.
    float distance_sq(const Box& other) const noexcept {
        const auto gap = [](float low_a, float high_a, float low_b, float high_b) {
            return std::max({0.0F, low_b - high_a, low_a - high_b});
        };
        const float x = gap(low.x(), high.x(), other.low.x(), other.high.x());
        const float y = gap(low.y(), high.y(), other.low.y(), other.high.y());
        const float z = gap(low.z(), high.z(), other.low.z(), other.high.z());
        return x * x + y * y + z * z;
    }
};

/// Sixteen points; what is missing in the last leaf lies at infinity.
struct alignas(64) Leaf {
    std::array<float, kLeaf> x, y, z;
    std::array<Index, kLeaf> index;

    Vec3f position(std::size_t lane) const noexcept { return {x[lane], y[lane], z[lane]}; }
};

class HilbertTree {
public:
    HilbertTree(std::span<const Vec3f> points, const RunContext& context) : size_(points.size()) {
        std::vector<Index> order = hilbert_order(points, context);
        parallel_for_blocks(points.size(), kTidied, context,
                            [&](std::size_t begin, std::size_t end) {
                                tidy(points, std::span(order).subspan(begin, end - begin));
                            });
        leaves_.resize((points.size() + kLeaf - 1) / kLeaf);
        levels_.emplace_back(leaves_.size());
        parallel_for_blocks(leaves_.size(), 1024, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t l = begin; l < end; ++l) fill_leaf(points, order, l);
        });
        while (levels_.back().size() > 1) {
            const std::vector<Box>& below = levels_.back();
            std::vector<Box> level((below.size() + kFanOut - 1) / kFanOut);
            for (std::size_t i = 0; i < below.size(); ++i) level[i / kFanOut].add(below[i]);
            levels_.push_back(std::move(level));
        }
    }

    std::size_t leaf_count() const noexcept { return leaves_.size(); }
    const Leaf& leaf(std::size_t l) const noexcept { return leaves_[l]; }
    const Box& box(std::size_t l) const noexcept { return levels_.front()[l]; }
    std::size_t points_in(std::size_t l) const noexcept {
        return std::min(kLeaf, size_ - l * kLeaf);
    }

    /// The leaves within `radius_sq` of `box`, in the order of the curve.
    void find_leaves(const Box& box, float radius_sq, std::vector<std::uint32_t>& found) const {
        found.clear();
        find_in(levels_.size() - 1, 0, box, radius_sq, found);
    }

private:
    /// Orders a stretch of the curve so that its leaves are compact: halved across its longest
    /// side, again and again. A surface runs in and out of the cells of the curve, whose own
    /// stretches of 16 points are scattered.
    static void tidy(std::span<const Vec3f> points, std::span<Index> stretch) {
        if (stretch.size() <= kLeaf) return;
        Box box;
        for (const Index i : stretch) box.add({points[i], points[i]});
        int axis = 0;
        (box.high - box.low).maxCoeff(&axis);
        const std::size_t half = (stretch.size() / 2 + kLeaf - 1) / kLeaf * kLeaf;
        std::nth_element(stretch.begin(), stretch.begin() + static_cast<std::ptrdiff_t>(half),
                         stretch.end(), [&](Index a, Index b) {
                             const float p = points[a][axis], q = points[b][axis];
                             return p < q || (p == q && a < b);
                         });
        tidy(points, stretch.first(half));
        tidy(points, stretch.subspan(half));
    }

    void fill_leaf(std::span<const Vec3f> points, std::span<const Index> order, std::size_t l) {
        Leaf& leaf = leaves_[l];
        Box& box = levels_.front()[l];
        for (std::size_t j = 0; j < kLeaf; ++j) {
            const std::size_t at = l * kLeaf + j;
            if (at < order.size()) {
                const Vec3f& p = points[order[at]];
                leaf.x[j] = p.x();
                leaf.y[j] = p.y();
                leaf.z[j] = p.z();
                leaf.index[j] = order[at];
                box.add({p, p});
            } else {
                leaf.x[j] = leaf.y[j] = leaf.z[j] = std::numeric_limits<float>::infinity();
                leaf.index[j] = std::numeric_limits<Index>::max();
            }
        }
    }

    void find_in(std::size_t level, std::size_t node, const Box& box, float radius_sq,
                 std::vector<std::uint32_t>& found) const {
        if (levels_[level][node].distance_sq(box) > radius_sq) return;
        if (level == 0) {
            found.push_back(static_cast<std::uint32_t>(node));
            return;
        }
        const std::size_t end = std::min((node + 1) * kFanOut, levels_[level - 1].size());
        for (std::size_t child = node * kFanOut; child < end; ++child) {
            find_in(level - 1, child, box, radius_sq, found);
        }
    }

    std::size_t size_;
    std::vector<Leaf> leaves_;
    std::vector<std::vector<Box>>
        levels_;  ///< boxes of the leaves, of eight leaves each, and so on to one
};

/// Squared distances of a leaf's points to q.
std::array<Float4, 4> distances_sq(const Leaf& leaf, const Vec3f& q) noexcept {
    std::array<Float4, 4> d;
    for (std::size_t g = 0; g < 4; ++g) {
        const Float4 dx = load(&leaf.x[4 * g]) - q.x();
        const Float4 dy = load(&leaf.y[4 * g]) - q.y();
        const Float4 dz = load(&leaf.z[4 * g]) - q.z();
        d[g] = dx * dx + dy * dy + dz * dz;
    }
    return d;
}

/// The bits of the lanes that are at most `limit`.
unsigned lanes_within(const std::array<Float4, 4>& d, float limit) noexcept {
    unsigned bits = 0;
    for (std::size_t g = 0; g < 4; ++g) bits |= lane_bits(d[g] <= limit) << (4 * g);
    return bits;
}

/// (squared distance, index) in one number that sorts as they do: a float that is not negative
/// sorts as its bits.
using PackedNeighbor = std::uint64_t;
constexpr PackedNeighbor make_neighbor(float distance_sq, Index index) noexcept {
    return static_cast<PackedNeighbor>(std::bit_cast<std::uint32_t>(distance_sq)) << 32U | index;
}
float distance_of(PackedNeighbor n) noexcept {
    return std::bit_cast<float>(static_cast<std::uint32_t>(n >> 32U));
}
Index index_of(PackedNeighbor n) noexcept {
    return static_cast<Index>(n);
}

/// Points that may be among the nearest, unsorted, and the choice of the nearest of them.
class Candidates {
public:
    /// Forgets all; makes room for the points of so many leaves.
    void clear(std::size_t leaves) {
        count_ = 0;
        distances_sq_.resize(std::max(distances_sq_.size(), leaves * kLeaf + kPadding));
        indices_.resize(distances_sq_.size());
    }

    /// Takes the points of a leaf that are at most `limit_sq` away, but not those in the lanes
    /// `left_out`.
    void take(const Leaf& leaf, const Vec3f& q, float limit_sq, unsigned left_out) noexcept {
        const std::array<Float4, 4> d = distances_sq(leaf, q);
        for (std::size_t g = 0; g < 4; ++g) {
            const unsigned lanes = lane_bits(d[g] <= limit_sq) & ~(left_out >> (4 * g)) & 15U;
            std::array<float, 4> lane_distances;
            __builtin_memcpy(lane_distances.data(), &d[g], sizeof d[g]);
            store_packed(distances_sq_.data() + count_, lane_distances.data(), lanes);
            store_packed(indices_.data() + count_, &leaf.index[4 * g], lanes);
            count_ += static_cast<std::size_t>(std::popcount(lanes));
        }
    }

    std::size_t count() const noexcept { return count_; }

    /// The distance of the k-th nearest. Changes the order of the candidates' distances: clear
    /// afterwards.
    float kth_distance_sq(unsigned k) {
        const auto kth = distances_sq_.begin() + (k - 1);
        std::nth_element(distances_sq_.begin(), kth,
                         distances_sq_.begin() + static_cast<std::ptrdiff_t>(count_));
        return *kth;
    }

    /// Writes the k nearest, sorted; there are as many.
    void select(unsigned k, Index* indices, float* distances) {
        if (count_ > kMaxRanked || !select_by_rank(k, indices, distances))
            select_by_sorting(k, indices, distances);
    }

private:
    static constexpr std::size_t kPadding =
        8;  ///< a packed store, or a group of ranks, may reach this far behind
    static constexpr std::size_t kMaxRanked = 192;  ///< more are quicker to sort

    /// The place of each is the number of those that are nearer: quadratic, but without a branch
    /// that could be mispredicted. False where equal distances leave a place empty.
    bool select_by_rank(unsigned k, Index* indices, float* distances) noexcept {
        std::array<std::int32_t, kMaxRanked + kPadding> rank;
        std::fill_n(distances_sq_.begin() + static_cast<std::ptrdiff_t>(count_), kPadding,
                    std::numeric_limits<float>::infinity());
        for (std::size_t i = 0; i < count_; i += 8) {
            const Float4 a = load(&distances_sq_[i]), b = load(&distances_sq_[i + 4]);
            Int4 nearer_a{}, nearer_b{};
            for (std::size_t j = 0; j < count_; ++j) {
                const float d = distances_sq_[j];
                nearer_a -= d < a;
                nearer_b -= d < b;
            }
            __builtin_memcpy(&rank[i], &nearer_a, sizeof nearer_a);
            __builtin_memcpy(&rank[i + 4], &nearer_b, sizeof nearer_b);
        }
        std::array<Index, kMaxRanked + kPadding> at;
        constexpr Index kEmpty = std::numeric_limits<Index>::max();
        // Of the places up to the one behind the k-th, since a tie may leave that one empty.
        const std::size_t places = std::min<std::size_t>(count_, k + std::size_t{1});
        std::fill_n(at.begin(), places, kEmpty);
        for (std::size_t i = 0; i < count_; ++i)
            at[static_cast<std::size_t>(rank[i])] = static_cast<Index>(i);
        if (std::find(at.begin(), at.begin() + static_cast<std::ptrdiff_t>(places), kEmpty) !=
            at.begin() + static_cast<std::ptrdiff_t>(places)) {
            return false;
        }
        for (unsigned i = 0; i < k; ++i) {
            indices[i] = indices_[at[i]];
            distances[i] = distances_sq_[at[i]];
        }
        return true;
    }

    void select_by_sorting(unsigned k, Index* indices, float* distances) {
        sorted_.resize(count_);
        for (std::size_t i = 0; i < count_; ++i)
            sorted_[i] = make_neighbor(distances_sq_[i], indices_[i]);
        const auto kth = sorted_.begin() + (k - 1);
        std::nth_element(sorted_.begin(), kth, sorted_.end());
        std::sort(sorted_.begin(), kth);
        for (unsigned i = 0; i < k; ++i) {
            indices[i] = index_of(sorted_[i]);
            distances[i] = distance_of(sorted_[i]);
        }
    }

    std::size_t count_ = 0;
    std::vector<float> distances_sq_;
    std::vector<Index> indices_;
    std::vector<PackedNeighbor> sorted_;
};

/// Answers for the points of one leaf at a time.
///
/// The distance to the k-th neighbour changes by no more than one moves, so each answer bounds the
/// next. Where rounding makes such a bound too small, fewer than k points lie within it, and the
/// search is made again without it: the answer never depends on the bound.
class LeafQuery {
public:
    LeafQuery(const HilbertTree& tree, unsigned k)
        : tree_(tree), k_(k), reach_((k + kLeaf - 1) / kLeaf), nearest_(k), nearest_sq_(k) {}

    /// Calls answer(index, neighbour indices, squared distances) for each point of the leaf.
    template <typename Answer>
    void run(std::size_t home, Answer&& answer) {
        const Leaf& leaf = tree_.leaf(home);
        const std::size_t count = tree_.points_in(home);
        const std::size_t middle = count / 2;
        radii_.fill(std::numeric_limits<float>::infinity());

        // The point in the middle first, to know how far the others will have to look.
        const Vec3f center = leaf.position(middle);
        look_around(Box{center, center}, limit_of(radius_on_the_curve(home, center)));
        ask(home, middle, answer);
        float farthest = 0;
        for (std::size_t j = 0; j < count; ++j)
            farthest = std::max(farthest, (leaf.position(j) - center).norm());
        look_around(tree_.box(home), limit_of(radii_[middle] + farthest));
        for (std::size_t j = 0; j < count; ++j) {
            if (j != middle) ask(home, j, answer);
        }
    }

private:
    /// A little more than the square of a bound, for its rounding; finite, so that nothing at
    /// infinity is taken.
    static float limit_of(float bound) noexcept {
        return std::min(bound * bound * 1.00001F, std::numeric_limits<float>::max());
    }

    /// Finds the leaves that the next answers choose from.
    void look_around(const Box& box, float limit_sq) {
        found_limit_sq_ = limit_sq;
        tree_.find_leaves(box, limit_sq, found_);
        for (auto& side : sides_) side.resize((found_.size() + 3) / 4 * 4);
        for (std::size_t i = 0; i < found_.size(); ++i) {
            const Box& b = tree_.box(found_[i]);
            for (int axis = 0; axis < 3; ++axis) {
                sides_[static_cast<std::size_t>(axis)][i] = b.low[axis];
                sides_[static_cast<std::size_t>(axis) + 3][i] = b.high[axis];
            }
        }
    }

    template <typename Answer>
    void ask(std::size_t home, std::size_t lane, Answer&& answer) {
        const Leaf& leaf = tree_.leaf(home);
        const Vec3f q = leaf.position(lane);
        collect(home, lane, q, std::min(limit_of(bound_from_answers(leaf, q)), found_limit_sq_));
        if (candidates_.count() < k_) collect_anywhere(home, lane, q);
        candidates_.select(k_, nearest_.data(), nearest_sq_.data());
        radii_[lane] = std::sqrt(nearest_sq_.back());
        answer(leaf.index[lane], std::span<const Index>(nearest_),
               std::span<const float>(nearest_sq_));
    }

    /// The least of the radii found in this leaf, each longer by the way to q.
    float bound_from_answers(const Leaf& leaf, const Vec3f& q) const noexcept {
        const std::array<Float4, 4> d = distances_sq(leaf, q);
        float bound = std::numeric_limits<float>::infinity();
        for (std::size_t j = 0; j < kLeaf; ++j)
            bound = std::min(bound, radii_[j] + std::sqrt(d[j / 4][j % 4]));
        return bound;
    }

    /// A radius around q that holds k points: of those in the leaves beside `home` on the curve.
    float radius_on_the_curve(std::size_t home, const Vec3f& q) {
        const std::size_t first = home - std::min(home, reach_);
        const std::size_t last = std::min(tree_.leaf_count() - 1, home + reach_);
        candidates_.clear(last - first + 1);
        for (std::size_t l = first; l <= last; ++l) {
            candidates_.take(tree_.leaf(l), q, std::numeric_limits<float>::max(), 0);
        }
        // One more than k, since q is among them.
        return candidates_.count() > k_ ? std::sqrt(candidates_.kth_distance_sq(k_ + 1))
                                        : std::numeric_limits<float>::infinity();
    }

    void collect(std::size_t home, std::size_t lane, const Vec3f& q, float limit_sq) {
        candidates_.clear(found_.size());
        for (std::size_t i = 0; i < found_.size(); i += 4) {
            Float4 distance_sq{};
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const float at = q[static_cast<Eigen::Index>(axis)];
                const Float4 below = load(&sides_[axis][i]) - at,
                             above = at - load(&sides_[axis + 3][i]);
                const Float4 outside = below > above ? below : above;
                const Float4 gap = outside > 0.0F ? outside : Float4{};
                distance_sq += gap * gap;
            }
            unsigned near = lane_bits(distance_sq <= limit_sq);
            for (; near != 0; near &= near - 1) {
                const std::size_t at = i + static_cast<std::size_t>(std::countr_zero(near));
                if (at >= found_.size()) break;
                candidates_.take(tree_.leaf(found_[at]), q, limit_sq,
                                 found_[at] == home ? 1U << lane : 0U);
            }
        }
    }

    /// All points but q.
    void collect_anywhere(std::size_t home, std::size_t lane, const Vec3f& q) {
        candidates_.clear(tree_.leaf_count());
        for (std::size_t l = 0; l < tree_.leaf_count(); ++l) {
            const unsigned missing = ~((1U << tree_.points_in(l)) - 1U);
            candidates_.take(tree_.leaf(l), q, std::numeric_limits<float>::infinity(),
                             missing | (l == home ? 1U << lane : 0U));
        }
    }

    const HilbertTree& tree_;
    unsigned k_;
    std::size_t reach_;  ///< leaves to either side that hold k points
    Candidates candidates_;
    std::vector<Index> nearest_;
    std::vector<float> nearest_sq_;
    std::vector<std::uint32_t> found_;
    std::array<std::vector<float>, 6>
        sides_;  ///< low x, y, z and high x, y, z of the boxes of `found_`
    float found_limit_sq_ = 0;
    std::array<float, kLeaf>
        radii_{};  ///< the answers of this leaf; infinite where there is none yet
};

}  // namespace

NeighborLists k_nearest_neighbors(std::span<const Vec3f> points, unsigned k,
                                  const RunContext& context) {
    if (k == 0) throw Error(ErrorCode::InvalidArgument, "k 0: expected at least 1 neighbour");
    NeighborLists lists;
    const std::size_t n = points.size();
    if (n == 0) {
        lists.offsets = {0};
        return lists;
    }
    const auto each = static_cast<unsigned>(std::min<std::size_t>(k, n - 1));
    lists.offsets.resize(n + 1);
    for (std::size_t i = 0; i <= n; ++i) lists.offsets[i] = i * each;
    lists.indices.resize(n * each);
    lists.distances_sq.resize(n * each);
    if (each == 0) return lists;

    const HilbertTree tree(points, context);
    parallel_for_blocks(
        tree.leaf_count(), kLeavesPerBlock, context, [&](std::size_t begin, std::size_t end) {
            LeafQuery query(tree, each);
            const auto write = [&](Index i, std::span<const Index> indices,
                                   std::span<const float> distances_sq) {
                std::ranges::copy(
                    indices, lists.indices.begin() + static_cast<std::ptrdiff_t>(lists.offsets[i]));
                std::ranges::copy(distances_sq, lists.distances_sq.begin() +
                                                    static_cast<std::ptrdiff_t>(lists.offsets[i]));
            };
            for (std::size_t l = begin; l < end; ++l) query.run(l, write);
        });
    return lists;
}

double mean_spacing(std::span<const Vec3f> points, const RunContext& context) {
    if (points.size() < 2) return 0.0;
    constexpr std::size_t kAsked = 65'536 / kLeaf;  // leaves
    const HilbertTree tree(points, context);
    const std::size_t step = std::max<std::size_t>(1, tree.leaf_count() / kAsked);
    const std::size_t asked = (tree.leaf_count() + step - 1) / step;
    std::vector<double> sums(asked);
    parallel_for_blocks(asked, kLeavesPerBlock, context, [&](std::size_t begin, std::size_t end) {
        LeafQuery query(tree, 1);
        for (std::size_t i = begin; i < end; ++i) {
            query.run(i * step, [&sums, i](Index, std::span<const Index>,
                                           std::span<const float> distances_sq) {
                sums[i] += std::sqrt(static_cast<double>(distances_sq.front()));
            });
        }
    });
    double sum = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < asked; ++i) {
        sum += sums[i];
        count += tree.points_in(i * step);
    }
    return sum / static_cast<double>(count);
}

NeighborLists radius_neighbors(std::span<const Vec3f> points, float radius,
                               const RunContext& context) {
    if (!(radius > 0) || !std::isfinite(radius)) {
        throw Error(ErrorCode::InvalidArgument,
                    "radius " + std::to_string(radius) + ": expected a finite length above 0");
    }
    NeighborLists lists;
    lists.offsets.assign(points.size() + 1, 0);
    if (points.empty()) return lists;
    const float radius_sq = radius * radius;
    const HilbertTree tree(points, context);

    // Calls visit(j, neighbor) for the points of each leaf of a block and whatever lies within the
    // radius.
    const auto for_pairs = [&](std::size_t begin, std::size_t end, auto&& visit) {
        std::vector<std::uint32_t> found;
        for (std::size_t home = begin; home < end; ++home) {
            tree.find_leaves(tree.box(home), radius_sq, found);
            const Leaf& leaf = tree.leaf(home);
            for (std::size_t j = 0; j < tree.points_in(home); ++j) {
                const Vec3f q = leaf.position(j);
                for (const std::uint32_t l : found) {
                    const Leaf& other = tree.leaf(l);
                    const std::array<Float4, 4> d = distances_sq(other, q);
                    for (unsigned lanes = lanes_within(d, radius_sq); lanes != 0;
                         lanes &= lanes - 1) {
                        const auto lane = static_cast<std::size_t>(std::countr_zero(lanes));
                        if (other.index[lane] == leaf.index[j]) continue;
                        visit(leaf.index[j],
                              make_neighbor(d[lane / 4][lane % 4], other.index[lane]));
                    }
                }
            }
        }
    };
    parallel_for_blocks(
        tree.leaf_count(), kLeavesPerBlock, context, [&](std::size_t begin, std::size_t end) {
            for_pairs(begin, end,
                      [&](Index i, PackedNeighbor) { ++lists.offsets[i + std::size_t{1}]; });
        });
    for (std::size_t i = 1; i < lists.offsets.size(); ++i) lists.offsets[i] += lists.offsets[i - 1];
    constexpr std::uint64_t kMaxPairs = std::uint64_t{1} << 32U;
    if (lists.offsets.back() > kMaxPairs) {
        throw Error(ErrorCode::TooLarge, std::to_string(lists.offsets.back()) +
                                             " pairs within radius " + std::to_string(radius) +
                                             ": expected at most 2^32; choose a smaller radius");
    }
    lists.indices.resize(lists.offsets.back());
    lists.distances_sq.resize(lists.offsets.back());
    parallel_for_blocks(tree.leaf_count(), kLeavesPerBlock, context,
                        [&](std::size_t begin, std::size_t end) {
                            std::vector<PackedNeighbor> list;
                            const auto write = [&](Index i) {
                                std::ranges::sort(list);
                                std::uint64_t to = lists.offsets[i];
                                for (const PackedNeighbor neighbor : list) {
                                    lists.indices[to] = index_of(neighbor);
                                    lists.distances_sq[to++] = distance_of(neighbor);
                                }
                                list.clear();
                            };
                            Index current = tree.leaf(begin).index[0];
                            for_pairs(begin, end, [&](Index i, PackedNeighbor neighbor) {
                                if (i != current) write(std::exchange(current, i));
                                list.push_back(neighbor);
                            });
                            write(current);
                        });
    return lists;
}

}  // namespace stipple
