#include "clustering/point_blocks.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"

#include <tbb/parallel_invoke.h>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

namespace stipple {

namespace {

constexpr std::size_t kParallelGrain = 8'192;  // samples below which a subtree is one task
constexpr std::size_t kMany = 1'048'576;       // beyond, samples are split a piece at a time
constexpr std::size_t kPiece = 8'192;

template <typename T>
void append(std::vector<T>& to, const std::vector<T>& more) {
    to.insert(to.end(), more.begin(), more.end());
}

SampleBox box_of(const SampleSpan& samples, const RunContext& context) {
    constexpr float kFar = std::numeric_limits<float>::infinity();
    SampleBox all = {{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}};
    for_blocks_in_order(samples.size, context, [&](std::size_t begin, std::size_t end) {
        const SampleBox part = cluster_kernels().box(samples.part(begin, end));
        for (std::size_t axis = 0; axis < 3; ++axis) {
            all.low[axis] = std::min(all.low[axis], part.low[axis]);
            all.high[axis] = std::max(all.high[axis], part.high[axis]);
        }
    });
    return all;
}

/// As the kernel of that name. Many samples are split a piece at a time, so that it can stop.
std::size_t split(const SampleSpan& from, const SplitPlane& plane, const MutableSampleSpan& to,
                  const RunContext& context) {
    if (from.size <= kMany) return cluster_kernels().partition(from, plane, to);
    Samples room(kPiece);
    std::size_t front = 0, back = from.size;
    for (std::size_t begin = 0; begin < from.size; begin += kPiece) {
        context.throw_if_stopped();
        const SampleSpan piece = from.part(begin, std::min(from.size, begin + kPiece));
        const MutableSampleSpan sides = room.all().part(0, piece.size);
        const std::size_t left = cluster_kernels().partition(piece, plane, sides);
        const std::size_t right = piece.size - left;
        copy_samples(sides.part(0, left), to.part(front, front + left));
        copy_samples(sides.part(left, piece.size), to.part(back - right, back));
        front += left;
        back -= right;
    }
    return front;
}

}  // namespace

PointBlocks::PointBlocks(std::span<const Vec3f> points, std::size_t most_in_block,
                         std::optional<float> scale, const RunContext& context)
    : size_(points.size()),
      most_in_block_(most_in_block),
      scale_(scale.value_or(1)),
      storage_(2 * points.size() + kSlack) {
    resize_in_blocks(taken_, size_ + kSlack, context);
    const MutableSampleSpan s = storage_.all();
    parallel_for_blocks(size_, 65'536, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            s.x[i] = points[i].x() * scale_;
            s.y[i] = points[i].y() * scale_;
            s.z[i] = points[i].z() * scale_;
            s.index[i] = static_cast<Index>(i);
        }
    });
    if (!scale) choose_scale(context);
    Leaves leaves;
    with_threads(context, [&] { partition(0, size_, false, leaves, context); });
    begins_ = std::move(leaves.begins);
    begins_.push_back(static_cast<Index>(size_));
    stack_levels(std::move(leaves.boxes));
}

void PointBlocks::free_all(const RunContext& context) {
    for_blocks_in_order(size_, context, [&](std::size_t begin, std::size_t end) {
        std::fill_n(&taken_[begin], end - begin, 0.0F);
    });
}

void PointBlocks::keep_block_from_seeding(Index place, Index begin, Index end) noexcept {
    const auto after = std::ranges::upper_bound(begins_, place);
    for (Index i = std::max(begin, *(after - 1)); i < std::min(end, *after); ++i)
        taken_[i] = taken_[i] > 0 ? taken_[i] : -1;
}

void PointBlocks::let_all_seed(const RunContext& context) {
    for_blocks_in_order(size_, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) taken_[i] = std::max(taken_[i], 0.0F);
    });
}

void PointBlocks::approach(const Vec3f& q, float radius, Vicinity& vicinity) const {
    constexpr float kRounding = 1.0001F;
    constexpr float kAhead = 3;        // radii: as far as looks to come may see
    constexpr std::size_t kMost = 32;  // groups that are worth it
    // One that a wide look left behind, as among stray points, is too much for narrow ones.
    const bool is_fit = vicinity.groups.size() <= kMost || vicinity.radius <= 2 * kAhead * radius;
    if (is_fit && kRounding * ((q - vicinity.center).lpNorm<1>() + radius) <= vicinity.radius)
        return;
    vicinity.center = q;
    for (const auto& [reach, most] :
         {std::pair(kAhead * radius, kMost), std::pair(radius, begins_.size())}) {
        vicinity.radius = reach;
        vicinity.groups.clear();
        add_groups(levels_.size() - 1, 0, most, vicinity);
        if (vicinity.groups.size() <= most) break;
    }
    vicinity.sample_count = 0;
    for (const Index group : vicinity.groups) {
        const std::size_t first = std::size_t{8} * group;
        vicinity.sample_count += begins_[std::min(first + 8, begins_.size() - 1)] - begins_[first];
    }
}

void PointBlocks::add_groups(std::size_t level, Index node, std::size_t at_most,
                             Vicinity& vicinity) const {
    if (level == 0) return vicinity.groups.push_back(node);
    const Vec3f& c = vicinity.center;
    unsigned near = cluster_kernels().boxes_within(levels_[level][node], {c.x(), c.y(), c.z()},
                                                   vicinity.radius * vicinity.radius);
    for (; near != 0 && vicinity.groups.size() <= at_most; near &= near - 1) {
        add_groups(level - 1, 8 * node + static_cast<Index>(std::countr_zero(near)), at_most,
                   vicinity);
    }
}

void PointBlocks::choose_scale(const RunContext& context) {
    const MutableSampleSpan s = storage_.all().part(0, size_);
    const SampleBox box = box_of(s, context);
    float longest = 0;
    for (std::size_t axis = 0; axis < 3; ++axis)
        longest = std::max(longest, 0.5F * box.high[axis] - 0.5F * box.low[axis]);
    constexpr int kHarmless = 40;  // whose squares, and what is small beside them, are no trouble
    const int exponent = longest > 0 ? std::ilogb(longest) : 0;
    if (std::abs(exponent) <= kHarmless) return;
    scale_ = std::ldexp(1.0F, std::clamp(-exponent, -126, 126));
    for (float* const v : {s.x, s.y, s.z})
        std::for_each(v, v + size_, [this](float& c) { c *= scale_; });
}

/// Splits the samples `begin..end`, which lie in the scratch space where they are aside: each split
/// moves them to the other place, and those of a block to where they belong.
void PointBlocks::partition(std::size_t begin, std::size_t end, bool is_aside, Leaves& leaves,
                            const RunContext& context) {
    const MutableSampleSpan here = storage_.all().part(begin, end),
                            aside = storage_.all().part(size_ + begin, size_ + end);
    const MutableSampleSpan &from = is_aside ? aside : here, &to = is_aside ? here : aside;
    const SampleBox box = box_of(from, context);
    std::size_t front = 0;
    if (from.size > most_in_block_) {
        std::array<float, 3> sides;
        std::ranges::transform(box.high, box.low, sides.begin(), std::minus<>());
        const auto axis = std::ranges::max_element(sides) - sides.begin();
        SplitPlane plane{box.low, {}, 0.5F * sides[static_cast<std::size_t>(axis)]};
        plane.normal[static_cast<std::size_t>(axis)] = 1;
        front = split(from, plane, to, context);
    }
    if (front == 0 || front == from.size) {  // few enough, or at one place but for rounding
        if (is_aside) copy_samples(from, to);
        leaves.begins.push_back(static_cast<Index>(begin));
        leaves.boxes.push_back(box);
        return;
    }
    const std::size_t middle = begin + front;
    if (from.size <= kParallelGrain || context.thread_count() == 1) {
        partition(begin, middle, !is_aside, leaves, context);
        partition(middle, end, !is_aside, leaves, context);
        return;
    }
    Leaves right;
    tbb::parallel_invoke([&] { partition(begin, middle, !is_aside, leaves, context); },
                         [&] { partition(middle, end, !is_aside, right, context); });
    append(leaves.begins, right.begins);
    append(leaves.boxes, right.boxes);
}

void PointBlocks::stack_levels(std::vector<SampleBox> boxes) {
    constexpr float kFar = std::numeric_limits<float>::infinity();
    const SampleBox missing = {{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}};
    do {
        std::vector<EightBoxes> level((boxes.size() + 7) / 8);
        std::vector<SampleBox> above(level.size(), missing);
        for (std::size_t child = 0; child < 8 * level.size(); ++child) {
            const SampleBox& box = child < boxes.size() ? boxes[child] : missing;
            SampleBox& parent = above[child / 8];
            for (std::size_t axis = 0; axis < 3; ++axis) {
                parent.low[axis] = std::min(parent.low[axis], box.low[axis]);
                parent.high[axis] = std::max(parent.high[axis], box.high[axis]);
                level[child / 8].low[axis][child % 8] = box.low[axis];
                level[child / 8].high[axis][child % 8] = box.high[axis];
            }
        }
        levels_.push_back(std::move(level));
        boxes = std::move(above);
    } while (boxes.size() > 1);
    const SampleBox& all = boxes.front();
    extent_ =
        std::max({all.high[0] - all.low[0], all.high[1] - all.low[1], all.high[2] - all.low[2]});
}

}  // namespace stipple
