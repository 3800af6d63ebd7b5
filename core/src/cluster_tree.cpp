#include "cluster_tree.hpp"

#include "float4.hpp"
#include "parallel_for.hpp"

#include <tbb/task_group.h>
#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <iterator>
#include <numeric>
#include <tuple>

// Follows: Pauly, Gross, Kobbelt 2002, §3.1; Shaffer and Garland 2001 (the same partition with a
// queue, for meshes).
//
// Coordinates lie in arrays of their own and are taken four at a time. Splitting a cluster is two
// passes: one that moves its points to either side, keeping their order, and one that takes the
// moments of the two halves while they are in the cache. Moments are sums of differences to a point
// of the cluster, in floats over a few samples and in doubles over all. Nothing is derived from a
// parent's sums, so rounding does not build up towards the leaves.
//
// The priority queue is not there: a child's priority is never above its parent's, so the first n -
// 1 splits of the queue are the n - 1 nodes of highest priority. That lets subtrees grow on their
// own threads, and any number of cuts be read off one tree.

namespace stipple {

namespace {

constexpr std::size_t kParallelGrain = 16'384;  // samples below which a subtree is one task
constexpr std::size_t kFlush = 32;              // groups of four summed up in floats

/// Moments relative to `reference`, which should be near the samples' centroid.
SampleMoments moments_about(const SampleSpan& samples, const Vec3f& reference) {
    std::array<Float4, 9> part{};
    std::array<double, 9> total{};
    const auto add = [&part](const Group& g) {
        part[0] += g.x;
        part[1] += g.y;
        part[2] += g.z;
        part[3] += g.x * g.x;
        part[4] += g.x * g.y;
        part[5] += g.x * g.z;
        part[6] += g.y * g.y;
        part[7] += g.y * g.z;
        part[8] += g.z * g.z;
    };
    const auto flush = [&] {
        for (std::size_t k = 0; k < total.size(); ++k) {
            total[k] += sum(part[k]);
            part[k] = Float4{};
        }
    };
    const std::size_t whole = samples.size / 4 * 4;
    std::size_t i = 0;
    for (; i + 4 * kFlush <= whole; flush()) {
        for (const std::size_t end = i + 4 * kFlush; i < end; i += 4) add(Group(samples, i, reference));
    }
    for (; i < whole; i += 4) add(Group(samples, i, reference));
    if (i < samples.size) add(Group::tail(samples, i, reference));
    flush();
    const double n = static_cast<double>(samples.size);
    const Vec3d d(total[0] / n, total[1] / n, total[2] / n);
    SampleMoments moments;
    moments.centroid = reference.cast<double>() + d;
    moments.scatter = {total[3] - n * d.x() * d.x(), total[4] - n * d.x() * d.y(),
                       total[5] - n * d.x() * d.z(), total[6] - n * d.y() * d.y(),
                       total[7] - n * d.y() * d.z(), total[8] - n * d.z() * d.z()};
    moments.eigenvalues = eigenvalues(moments.scatter);
    return moments;
}

/// The plane that splits a cluster: through its centroid, across the direction of largest extent.
struct SplitPlane {
    Vec3f reference, normal;
    float offset;

    explicit SplitPlane(const SampleMoments& moments) {
        const Vec3d direction = eigenvector(moments.scatter, moments.eigenvalues[2]);
        reference = moments.centroid.cast<float>();
        normal = direction.cast<float>();
        offset = static_cast<float>(direction.dot(moments.centroid - reference.cast<double>()));
    }
    Int4 left_of(const Group& g) const noexcept {
        return g.x * normal.x() + g.y * normal.y() + g.z * normal.z() < offset;
    }
};

/// Copies n values, four at a time: most clusters are so small that a call to memcpy costs more.
template <typename T>
void copy_four(const T* from, std::size_t n, T* to) noexcept {
    static_assert(sizeof(T) == 4);
    std::size_t i = 0;
    for (; i + 4 <= n; i += 4) __builtin_memcpy(to + i, from + i, 16);
    for (; i < n; ++i) to[i] = from[i];
}

/// Moves the samples left of the plane to the front and the others behind them, both in their
/// order. `scratch` has as many.
Index partition(const MutableSampleSpan& s, const SplitPlane& plane,
                const MutableSampleSpan& scratch) {
    std::size_t front = 0, back = 0;
    const std::size_t whole = s.size / 4 * 4;
    // Neither side is longer than what was read, so a store of four reaches no further than the
    // four just read.
    for (std::size_t i = 0; i < whole; i += 4) {
        const unsigned left = lane_bits(plane.left_of(Group(s, i, plane.reference)));
        const unsigned right = ~left & 15U;
        store_packed(scratch.x + back, s.x + i, right);
        store_packed(scratch.y + back, s.y + i, right);
        store_packed(scratch.z + back, s.z + i, right);
        store_packed(scratch.index + back, s.index + i, right);
        store_packed(s.x + front, s.x + i, left);
        store_packed(s.y + front, s.y + i, left);
        store_packed(s.z + front, s.z + i, left);
        store_packed(s.index + front, s.index + i, left);
        const auto count = static_cast<std::size_t>(std::popcount(left));
        front += count;
        back += 4 - count;
    }
    if (whole < s.size) {
        const unsigned left = lane_bits(plane.left_of(Group::tail(s, whole, plane.reference)));
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
    }
    copy_four(scratch.x, back, s.x + front);
    copy_four(scratch.y, back, s.y + front);
    copy_four(scratch.z, back, s.z + front);
    copy_four(scratch.index, back, s.index + front);
    return static_cast<Index>(front);
}

/// What splitting a cluster is worth: its total variation (Eq. 3), which keeps the spacing even,
/// the more so the less flat it is. Of the forms tried (size, total variation, lambda_0 and
/// products of them) this had the lowest mean error on smooth and on rough scans; the first term
/// bounds the spacing of flat parts.
double priority_of(const ClusterNode& node) {
    if (!node.can_split()) return -1;
    constexpr double kFlat = 0.02;
    return node.moments.scatter.trace() * (kFlat + std::sqrt(node.moments.variation()));
}

/// Where rounding leaves all samples on one side of the plane, halves them along the longest axis.
Index halve(const MutableSampleSpan& s) {
    Vec3f low = s.position(0), high = low;
    for (std::size_t i = 0; i < s.size; ++i) {
        low = low.cwiseMin(s.position(i));
        high = high.cwiseMax(s.position(i));
    }
    int axis = 0;
    (high - low).maxCoeff(&axis);
    std::vector<Index> order(s.size);
    std::iota(order.begin(), order.end(), Index{0});
    std::ranges::sort(order, [&](Index a, Index b) {
        const float p = s.position(a)[axis], q = s.position(b)[axis];
        return p < q || (p == q && a < b);
    });
    Samples copy(s.size);
    const MutableSampleSpan old = copy.all();
    std::copy_n(s.x, s.size, old.x);
    std::copy_n(s.y, s.size, old.y);
    std::copy_n(s.z, s.size, old.z);
    std::copy_n(s.index, s.size, old.index);
    for (std::size_t i = 0; i < s.size; ++i) {
        s.x[i] = old.x[order[i]];
        s.y[i] = old.y[order[i]];
        s.z[i] = old.z[order[i]];
        s.index[i] = old.index[order[i]];
    }
    return static_cast<Index>(s.size / 2);
}

/// The samples of the tree and their scratch space.
struct Workspace {
    MutableSampleSpan samples, scratch;
};

/// Splits `node` in two. @return left and right.
std::pair<ClusterNode, ClusterNode> split(const ClusterNode& node, const Workspace& space) {
    const MutableSampleSpan samples = space.samples.part(node.begin, node.end);
    const SplitPlane plane(node.moments);
    Index front = partition(samples, plane, space.scratch.part(node.begin, node.end));
    if (front == 0 || front == node.size()) front = halve(samples);

    ClusterNode left, right;
    left.begin = node.begin;
    left.end = right.begin = node.begin + front;
    right.end = node.end;
    left.moments = moments_about(samples.part(0, front), plane.reference);
    right.moments = moments_about(samples.part(front, samples.size), plane.reference);
    left.priority = std::min(node.priority, priority_of(left));
    right.priority = std::min(node.priority, priority_of(right));
    return {left, right};
}

/// Grows the subtree of `nodes[top]`, which is a leaf, on this thread.
void grow_here(std::vector<ClusterNode>& nodes, Index top, const Workspace& space,
               const std::function<bool(const ClusterNode&)>& wanted, const RunContext& context) {
    std::vector<Index> open = {top};
    while (!open.empty()) {
        const Index id = open.back();
        open.pop_back();
        if (!nodes[id].can_split() || !wanted(nodes[id])) continue;
        if (nodes[id].size() > kParallelGrain) context.throw_if_stopped();
        const auto [left, right] = split(nodes[id], space);
        nodes[id].left = static_cast<Index>(nodes.size());
        nodes[id].right = nodes[id].left + 1;
        nodes.push_back(left);
        nodes.push_back(right);
        open.push_back(nodes[id].right);
        open.push_back(nodes[id].left);
    }
}

/// Puts the subtree `branch` (its root first) in place of `nodes[leaf]`.
void graft(std::vector<ClusterNode>& nodes, Index leaf, std::vector<ClusterNode>&& branch) {
    const Index shift = static_cast<Index>(nodes.size()) - 1;  // the branch's root stays at `leaf`
    for (ClusterNode& node : branch) {
        if (!node.is_split()) continue;
        node.left += shift;
        node.right += shift;
    }
    nodes[leaf] = branch.front();
    nodes.insert(nodes.end(), branch.begin() + 1, branch.end());
}

/// The subtree of a leaf, grown on as many threads as the arena has. The same nodes in the same
/// order for any of them.
std::vector<ClusterNode> grow_branch(const ClusterNode& leaf, const Workspace& space,
                                     const std::function<bool(const ClusterNode&)>& wanted,
                                     const RunContext& context) {
    std::vector<ClusterNode> nodes = {leaf};
    if (leaf.size() <= kParallelGrain || !wanted(leaf)) {
        grow_here(nodes, 0, space, wanted, context);
        return nodes;
    }
    context.throw_if_stopped();
    const auto [left, right] = split(leaf, space);
    std::vector<ClusterNode> right_branch;
    tbb::task_group group;
    group.run([&, right = right] { right_branch = grow_branch(right, space, wanted, context); });
    std::vector<ClusterNode> left_branch;
    std::exception_ptr failure;
    try {
        left_branch = grow_branch(left, space, wanted, context);
    } catch (...) {
        failure = std::current_exception();
    }
    group.wait();  // always: the task refers to this frame
    if (failure) std::rethrow_exception(failure);

    nodes.reserve(1 + left_branch.size() + right_branch.size());
    nodes.resize(3);
    nodes[0].left = 1;
    nodes[0].right = 2;
    graft(nodes, 1, std::move(left_branch));
    graft(nodes, 2, std::move(right_branch));
    return nodes;
}

}  // namespace

SampleMoments moments_of(const SampleSpan& samples) {
    return moments_about(samples, samples.position(0));
}

ClusterTree::ClusterTree(std::span<const Vec3f> points, const RunContext& context)
    : samples_(points.size()), scratch_(points.size()) {
    assert(!points.empty());
    const MutableSampleSpan samples = samples_.all();
    parallel_for_blocks(points.size(), 65'536, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            samples.x[i] = points[i].x();
            samples.y[i] = points[i].y();
            samples.z[i] = points[i].z();
            samples.index[i] = static_cast<Index>(i);
        }
    });
    ClusterNode root;
    root.end = static_cast<Index>(points.size());
    root.moments = moments_of(samples);
    root.priority = priority_of(root);
    nodes_.push_back(root);
}

void ClusterTree::grow(const std::function<bool(const ClusterNode&)>& wanted,
                       const RunContext& context) {
    std::vector<Index> open;
    for (Index id = 0; id < nodes_.size(); ++id) {
        if (!nodes_[id].is_split() && nodes_[id].can_split() && wanted(nodes_[id]))
            open.push_back(id);
    }
    std::vector<std::vector<ClusterNode>> branches(open.size());
    with_threads(context, [&] {
        tbb::parallel_for(std::size_t{0}, open.size(), [&](std::size_t i) {
            branches[i] =
                grow_branch(nodes_[open[i]], {samples_.all(), scratch_.all()}, wanted, context);
        });
    });
    for (std::size_t i = 0; i < open.size(); ++i) graft(nodes_, open[i], std::move(branches[i]));
}

Cut ClusterTree::cut(std::uint64_t size, const RunContext& context) {
    assert(size >= 1 && size <= samples_.size());
    // Most clusters larger than the average will be split: grow those at once, depth first, while
    // they are in the cache.
    const double likely = 1.5 * static_cast<double>(samples_.size()) / static_cast<double>(size);
    grow([likely](const ClusterNode& node) { return node.size() > likely; }, context);

    const auto first =
        [this](Index a, Index b) {  // a total order in which a parent stands before its children
            const ClusterNode &p = nodes_[a], &q = nodes_[b];
            if (p.priority != q.priority) return p.priority > q.priority;
            return p.begin != q.begin ? p.begin < q.begin : p.size() > q.size();
        };
    const std::size_t splits = size - 1;
    std::vector<Index> order;
    while (true) {
        order.clear();
        for (Index id = 0; id < nodes_.size(); ++id) {
            if (nodes_[id].can_split()) order.push_back(id);
        }
        const std::size_t chosen = std::min(splits, order.size());
        std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(chosen),
                         order.end(), first);
        order.resize(chosen);
        std::vector<char> is_chosen(nodes_.size());
        bool complete = chosen == splits;
        for (const Index id : order) {
            is_chosen[id] = 1;
            complete = complete && nodes_[id].is_split();
        }
        if (complete) return cut_where([&](Index id) { return is_chosen[id] != 0; });
        split_leaves(order, context);  // their children may take the place of others: look again
    }
}

void ClusterTree::split_leaves(std::span<const Index> nodes, const RunContext& context) {
    std::vector<Index> leaves;
    std::ranges::copy_if(nodes, std::back_inserter(leaves),
                         [this](Index id) { return !nodes_[id].is_split(); });
    std::ranges::sort(leaves);
    const std::size_t old_size = nodes_.size();
    nodes_.resize(old_size + 2 * leaves.size());
    parallel_for_blocks(leaves.size(), 64, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            ClusterNode& node = nodes_[leaves[i]];
            node.left = static_cast<Index>(old_size + 2 * i);
            node.right = node.left + 1;
            std::tie(nodes_[node.left], nodes_[node.right]) =
                split(node, {samples_.all(), scratch_.all()});
        }
    });
}

Cut ClusterTree::leaves() const {
    return cut_where([this](Index id) { return nodes_[id].is_split(); });
}

Cut ClusterTree::cut_where(const std::function<bool(Index)>& descends) const {
    Cut cut;
    std::vector<Index> open = {0};
    while (!open.empty()) {
        const ClusterNode& node = nodes_[open.back()];
        const bool is_inner = descends(open.back());
        open.pop_back();
        if (is_inner) {
            open.push_back(node.right);
            open.push_back(node.left);
        } else {
            cut.offsets.push_back(node.begin);
            cut.moments.push_back(node.moments);
        }
    }
    cut.offsets.push_back(nodes_.front().end);
    return cut;
}

}  // namespace stipple
