#include "neighbors/point_tree.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "cloud/float4.hpp"
#include "cloud/hilbert_order.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <numeric>

namespace stipple {

namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

struct Box {
    Vec3f low = Vec3f::Constant(kInfinity);
    Vec3f high = Vec3f::Constant(-kInfinity);

    void add(const Vec3f& p) noexcept {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
    void add(const Box& other) noexcept {
        low = low.cwiseMin(other.low);
        high = high.cwiseMax(other.high);
    }
};

void set_child(PointTree::Node& node, std::size_t child, const Box& box) noexcept {
    for (std::size_t axis = 0; axis < 3; ++axis) {
        node.low[axis][child] = box.low[static_cast<Eigen::Index>(axis)];
        node.high[axis][child] = box.high[static_cast<Eigen::Index>(axis)];
    }
}

Index lowest_of(const std::array<Index, PointTree::kWidth>& indices) noexcept {
    return *std::ranges::min_element(indices);
}

Box box_of(const PointTree::Node& node) noexcept {
    Box box;
    for (std::size_t child = 0; child < PointTree::kWidth; ++child) {
        box.add(Box{{node.low[0][child], node.low[1][child], node.low[2][child]},
                    {node.high[0][child], node.high[1][child], node.high[2][child]}});
    }
    return box;
}

PointTree::Node empty_node() noexcept {
    PointTree::Node node;
    for (std::size_t child = 0; child < PointTree::kWidth; ++child) set_child(node, child, {});
    node.lowest.fill(PointTree::kNone);
    return node;
}

constexpr std::size_t kWidth = PointTree::kWidth;

/// Of each of four the least or largest of its lanes, as `choose` has it of two.
template <typename Choose>
Float4 folded(const Float4* four, const Choose& choose) noexcept {
    const auto halves = [&](Float4 a, Float4 b) {
        return choose(__builtin_shufflevector(a, b, 0, 1, 4, 5),
                      __builtin_shufflevector(a, b, 2, 3, 6, 7));
    };
    const Float4 first = halves(four[0], four[1]), second = halves(four[2], four[3]);
    return choose(__builtin_shufflevector(first, second, 0, 2, 4, 6),
                  __builtin_shufflevector(first, second, 1, 3, 5, 7));
}

/// The leaves of a node, eight at most, and their boxes.
class LeafWriter {
public:
    /// @param points  the coordinates of eight, one point after the other.
    void write(std::size_t child, const float* points, PointTree::Leaf& leaf) noexcept {
        std::array<std::array<Float4, 2>, 3> axes;
        for (std::size_t half = 0; half < 2; ++half) {
            std::array<Float4, 3> v;  // x y z x, y z x y, z x y z
            std::memcpy(v.data(), points + 12 * half, sizeof v);
            axes[0][half] =
                __builtin_shufflevector(__builtin_shufflevector(v[0], v[1], 0, 3, 6, 6), v[2],  //
                                        0, 1, 2, 5);
            axes[1][half] =
                __builtin_shufflevector(__builtin_shufflevector(v[0], v[1], 1, 4, 7, 7), v[2],  //
                                        0, 1, 2, 6);
            axes[2][half] =
                __builtin_shufflevector(__builtin_shufflevector(v[0], v[1], 2, 5, 5, 5), v[2],  //
                                        0, 1, 4, 7);
        }
        std::memcpy(&leaf.x, axes[0].data(), sizeof leaf.x);
        std::memcpy(&leaf.y, axes[1].data(), sizeof leaf.y);
        std::memcpy(&leaf.z, axes[2].data(), sizeof leaf.z);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            low_[axis][child] = smaller(axes[axis][0], axes[axis][1]);
            high_[axis][child] = larger(axes[axis][0], axes[axis][1]);
        }
    }

    /// The boxes of the first `children` leaves; the others are empty.
    void boxes(std::size_t children, PointTree::Node& node) noexcept {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            for (std::size_t child = children; child < kWidth; ++child) {
                low_[axis][child] = splat(kInfinity);
                high_[axis][child] = splat(-kInfinity);
            }
            for (std::size_t half = 0; half < 2; ++half) {
                store(&node.low[axis][4 * half], folded(&low_[axis][4 * half], smaller));
                store(&node.high[axis][4 * half], folded(&high_[axis][4 * half], larger));
            }
        }
    }

private:
    std::array<std::array<Float4, kWidth>, 3> low_, high_;  ///< of two points each
};

struct Numbered {
    Vec3f position;
    Index number;
};

/// Orders a stretch of the curve so that its leaves are compact: halved across its longest side,
/// again and again. A surface runs in and out of the cells of the curve, whose own stretches of
/// eight points are scattered.
void tidy(std::span<Numbered> stretch, const RunContext& context) {
    constexpr std::size_t kLeaf = kWidth, kMany = 8'192;
    if (stretch.size() <= kLeaf) return;
    if (stretch.size() > kMany) context.throw_if_stopped();
    Box box;
    for (const Numbered& point : stretch) box.add(point.position);
    int axis = 0;
    (box.high - box.low).maxCoeff(&axis);
    // Whole leaves and nodes go left: the first part is as large as a power of two can be.
    const std::size_t half = std::bit_floor(stretch.size() - 1);
    std::nth_element(stretch.begin(), stretch.begin() + static_cast<std::ptrdiff_t>(half),
                     stretch.end(), [axis](const Numbered& a, const Numbered& b) {
                         const float p = a.position[axis], q = b.position[axis];
                         return p < q || (p == q && a.number < b.number);
                     });
    tidy(stretch.first(half), context);
    tidy(stretch.subspan(half), context);
}

void tidy(std::span<const Vec3f> points, std::span<Index> order, const RunContext& context) {
    std::vector<Numbered> stretch;
    stretch.reserve(order.size());
    for (const Index i : order) stretch.push_back({points[i], i});
    tidy(std::span(stretch), context);
    std::ranges::transform(stretch, order.begin(), &Numbered::number);
}

}  // namespace

PointTree::PointTree(std::span<const Vec3f> points, Leaves leaves, const RunContext& context)
    : size_(points.size()) {
    std::vector<Index> order;  // none: as the points stand
    if (leaves != Leaves::Given)
        order =
            hilbert_order(points, context, leaves == Leaves::Loose ? Curve::Coarse : Curve::Fine);
    if (leaves == Leaves::Compact) {
        constexpr std::size_t kTidied = 65'536;
        parallel_for_blocks(size_, kTidied, context, [&](std::size_t begin, std::size_t end) {
            tidy(points, std::span(order).subspan(begin, end - begin), context);
        });
    }
    if (size_ == 0) return;
    leaves_ = LargeArray<Leaf>((size_ + kWidth - 1) / kWidth);
    std::vector<Node>* level = &levels_.emplace_back();
    resize_in_blocks(*level, (leaves_.size() + kWidth - 1) / kWidth, context);
    parallel_for_blocks(level->size(), 256, context, [&](std::size_t begin, std::size_t end) {
        LeafWriter leaf_writer;
        for (std::size_t n = begin; n < end; ++n) {
            const std::size_t first = n * kWidth, last = std::min(first + kWidth, leaves_.size());
            for (std::size_t l = first; l < last; ++l) {
                const std::size_t count = points_in(l);
                if (order.empty() && count == kWidth) {
                    leaf_writer.write(l - first, points[l * kWidth].data(), leaves_[l]);
                    std::iota(leaves_[l].index.begin(), leaves_[l].index.end(),
                              static_cast<Index>(l * kWidth));
                    (*level)[n].lowest[l - first] = static_cast<Index>(l * kWidth);
                    continue;
                }
                std::array<Vec3f, kWidth> eight;
                for (std::size_t lane = 0; lane < kWidth; ++lane) {
                    const std::size_t at = l * kWidth + std::min(lane, count - 1);
                    leaves_[l].index[lane] = order.empty() ? static_cast<Index>(at) : order[at];
                    eight[lane] = points[leaves_[l].index[lane]];
                }
                leaf_writer.write(l - first, eight.front().data(), leaves_[l]);
                for (std::size_t lane = count; lane < kWidth; ++lane) {
                    leaves_[l].x[lane] = leaves_[l].y[lane] = leaves_[l].z[lane] = kInfinity;
                    leaves_[l].index[lane] = kNone;
                }
                (*level)[n].lowest[l - first] = lowest_of(leaves_[l].index);
            }
            leaf_writer.boxes(last - first, (*level)[n]);
            for (std::size_t l = last; l < first + kWidth; ++l)
                (*level)[n].lowest[l - first] = kNone;
        }
    });
    while (level->size() > 1) {
        std::vector<Node> above((level->size() + kWidth - 1) / kWidth, empty_node());
        for (std::size_t n = 0; n < level->size(); ++n) {
            set_child(above[n / kWidth], n % kWidth, box_of((*level)[n]));
            above[n / kWidth].lowest[n % kWidth] = lowest_of((*level)[n].lowest);
        }
        level = &levels_.emplace_back(std::move(above));
    }
    for (std::size_t l = 0; l < levels_.size(); ++l) {
        level_data_.push_back(levels_[l].data());
        child_counts_.push_back(static_cast<std::uint32_t>(child_count(l)));
    }
}

}  // namespace stipple
