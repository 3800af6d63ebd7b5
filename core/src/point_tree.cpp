#include "point_tree.hpp"

#include "first_touch.hpp"
#include "hilbert_order.hpp"
#include "parallel_for.hpp"

#include <algorithm>
#include <bit>

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
    return node;
}

struct Numbered {
    Vec3f position;
    Index number;
};

/// Orders a stretch of the curve so that its leaves are compact: halved across its longest side,
/// again and again. A surface runs in and out of the cells of the curve, whose own stretches of
/// eight points are scattered.
void tidy(std::span<Numbered> stretch, const RunContext& context) {
    constexpr std::size_t kLeaf = PointTree::kWidth, kMany = 8'192;
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
        for (std::size_t n = begin; n < end; ++n) {
            Node& node = (*level)[n] = empty_node();
            const std::size_t last = std::min((n + 1) * kWidth, leaves_.size());
            for (std::size_t l = n * kWidth; l < last; ++l) {
                Box box;
                for (std::size_t lane = 0; lane < kWidth; ++lane) {
                    const bool missing = lane >= points_in(l);
                    const std::size_t at = l * kWidth + lane;
                    const Index i = missing         ? kNone
                                    : order.empty() ? static_cast<Index>(at)
                                                    : order[at];
                    const Vec3f p = missing ? Vec3f::Constant(kInfinity) : points[i];
                    leaves_[l].x[lane] = p.x();
                    leaves_[l].y[lane] = p.y();
                    leaves_[l].z[lane] = p.z();
                    leaves_[l].index[lane] = i;
                    if (!missing) box.add(p);
                }
                set_child(node, l % kWidth, box);
            }
        }
    });
    while (level->size() > 1) {
        std::vector<Node> above((level->size() + kWidth - 1) / kWidth, empty_node());
        for (std::size_t n = 0; n < level->size(); ++n)
            set_child(above[n / kWidth], n % kWidth, box_of((*level)[n]));
        level = &levels_.emplace_back(std::move(above));
    }
    for (std::size_t l = 0; l < levels_.size(); ++l) {
        level_data_.push_back(levels_[l].data());
        child_counts_.push_back(static_cast<std::uint32_t>(child_count(l)));
    }
}

}  // namespace stipple
