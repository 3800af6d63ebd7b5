#include "point_blocks.hpp"

#include "cluster_kernels.hpp"
#include "parallel_for.hpp"

#include <tbb/parallel_invoke.h>
#include <algorithm>
#include <cmath>

namespace stipple {

namespace {

constexpr std::size_t kParallelGrain = 8'192;  // samples below which a subtree is one task

template <typename T>
void append(std::vector<T>& to, const std::vector<T>& more) {
    to.insert(to.end(), more.begin(), more.end());
}

}  // namespace

float scale_near_one(std::span<const Vec3f> points) {
    Vec3f low = points.front(), high = low;
    for (const Vec3f& p : points) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
    const double extent = (high.cast<double>() - low.cast<double>()).maxCoeff();
    if (!(extent > 0)) return 1;
    return static_cast<float>(std::ldexp(1.0, std::clamp(-std::ilogb(extent), -126, 126)));
}

PointBlocks::PointBlocks(std::span<const Vec3f> points, float scale, const RunContext& context)
    : size_(points.size()), storage_(2 * points.size() + 4), taken_(points.size() + 4) {
    const MutableSampleSpan s = storage_.all();
    parallel_for_blocks(size_, 65'536, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            s.x[i] = points[i].x() * scale;
            s.y[i] = points[i].y() * scale;
            s.z[i] = points[i].z() * scale;
            s.index[i] = static_cast<Index>(i);
        }
    });
    Leaves leaves;
    with_threads(context, [&] { partition(0, size_, leaves, context); });
    begins_ = std::move(leaves.begins);
    begins_.push_back(static_cast<Index>(size_));
    stack_levels(std::move(leaves.boxes));
}

PointBlocks::Box PointBlocks::box_of(const SampleSpan& s) noexcept {
    constexpr float kFar = std::numeric_limits<float>::infinity();
    std::array<Float4, 3> low, high;
    low.fill(Float4{kFar, kFar, kFar, kFar});
    high.fill(-low[0]);
    const auto add = [&](std::size_t axis, Float4 v) {
        low[axis] = v < low[axis] ? v : low[axis];
        high[axis] = v > high[axis] ? v : high[axis];
    };
    std::size_t i = 0;
    for (; i + 4 <= s.size; i += 4) {
        add(0, load(s.x + i));
        add(1, load(s.y + i));
        add(2, load(s.z + i));
    }
    for (; i < s.size; ++i) {
        add(0, Float4{} + s.x[i]);
        add(1, Float4{} + s.y[i]);
        add(2, Float4{} + s.z[i]);
    }
    Box box;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const Float4 a = low[axis], b = high[axis];
        box.low[static_cast<Eigen::Index>(axis)] = std::min({a[0], a[1], a[2], a[3]});
        box.high[static_cast<Eigen::Index>(axis)] = std::max({b[0], b[1], b[2], b[3]});
    }
    return box;
}

void PointBlocks::partition(std::size_t begin, std::size_t end, Leaves& leaves,
                            const RunContext& context) {
    const MutableSampleSpan samples = storage_.all().part(begin, end);
    const Box box = box_of(samples);
    std::size_t front = 0;
    if (samples.size > kMostInBlock) {
        Eigen::Index axis = 0;
        const float longest = (box.high - box.low).maxCoeff(&axis);
        SplitPlane plane{{box.low.x(), box.low.y(), box.low.z()}, {}, 0.5F * longest};
        plane.normal[static_cast<std::size_t>(axis)] = 1;
        front = cluster_kernels().partition(samples, plane,
                                            storage_.all().part(size_ + begin, size_ + end));
    }
    if (front == 0 || front == samples.size) {  // few enough, or at one place but for rounding
        leaves.begins.push_back(static_cast<Index>(begin));
        leaves.boxes.push_back(box);
        return;
    }
    const std::size_t middle = begin + front;
    if (samples.size <= kParallelGrain || context.thread_count() == 1) {
        partition(begin, middle, leaves, context);
        partition(middle, end, leaves, context);
        return;
    }
    context.throw_if_stopped();
    Leaves right;
    tbb::parallel_invoke([&] { partition(begin, middle, leaves, context); },
                         [&] { partition(middle, end, right, context); });
    append(leaves.begins, right.begins);
    append(leaves.boxes, right.boxes);
}

void PointBlocks::stack_levels(std::vector<Box> boxes) {
    constexpr float kFar = std::numeric_limits<float>::infinity();
    const Box missing = {Vec3f::Constant(kFar), Vec3f::Constant(-kFar)};
    do {
        std::vector<Node> level((boxes.size() + 7) / 8);
        std::vector<Box> above(level.size(), missing);
        for (std::size_t child = 0; child < 8 * level.size(); ++child) {
            const Box& box = child < boxes.size() ? boxes[child] : missing;
            Box& parent = above[child / 8];
            parent.low = parent.low.cwiseMin(box.low);
            parent.high = parent.high.cwiseMax(box.high);
            for (Eigen::Index axis = 0; axis < 3; ++axis) {
                const auto a = static_cast<std::size_t>(axis);
                level[child / 8].low[a][child % 8] = box.low[axis];
                level[child / 8].high[a][child % 8] = box.high[axis];
            }
        }
        levels_.push_back(std::move(level));
        boxes = std::move(above);
    } while (boxes.size() > 1);
}

}  // namespace stipple
