#include "cluster_tree.hpp"

#include "cluster_kernels.hpp"
#include "parallel_for.hpp"

#include <tbb/task_group.h>
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <numeric>
#include <tuple>

// Follows: Pauly, Gross, Kobbelt 2002, §3.1; Shaffer and Garland 2001 (the same partition with a
// queue, for meshes).
//
// Coordinates lie in arrays of their own and are taken eight at a time. Splitting a cluster is two
// passes: one that moves its points to either side, keeping their order, and one that takes the
// moments of the two halves while they are in the cache. Moments are sums of differences to a point
// of the cluster, in floats over a few samples and in doubles over all. Nothing is derived from a
// parent's sums, so rounding does not build up towards the leaves.
//
// The priority queue is not there: a child's priority is never above its parent's, so the first
// splits of the queue, one fewer than the clusters wanted, are as many nodes of highest priority.
// That lets subtrees grow on their own threads, and any number of cuts be read off one tree.

namespace stipple {

namespace {

constexpr std::size_t kParallelGrain = 8'192;  // samples below which a subtree is one task

/// Moments relative to `reference`, which should be near the samples' centroid.
SampleMoments moments_about(const SampleSpan& samples, const std::array<float, 3>& reference) {
    const SampleSums s = cluster_kernels().sums(samples, reference);
    const double n = static_cast<double>(samples.size);
    const double x = s[0] / n, y = s[1] / n, z = s[2] / n;
    SampleMoments moments;
    moments.centroid =
        Vec3d(static_cast<double>(reference[0]) + x, static_cast<double>(reference[1]) + y,
              static_cast<double>(reference[2]) + z);
    moments.scatter = {s[3] - n * x * x, s[4] - n * x * y, s[5] - n * x * z,
                       s[6] - n * y * y, s[7] - n * y * z, s[8] - n * z * z};
    moments.eigenvalues = eigenvalues(moments.scatter);
    return moments;
}

/// Through the centroid, across the direction of largest extent.
SplitPlane split_plane(const SampleMoments& moments) {
    const Vec3d direction = eigenvector(moments.scatter, moments.eigenvalues[2]);
    const Vec3f reference = moments.centroid.cast<float>(), normal = direction.cast<float>();
    return {{reference.x(), reference.y(), reference.z()},
            {normal.x(), normal.y(), normal.z()},
            static_cast<float>(direction.dot(moments.centroid - reference.cast<double>()))};
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

/// A node in the order of splitting: a total order in which a parent stands before its children.
struct Ranked {
    double priority;
    Index begin, size, id;

    bool operator<(const Ranked& other) const noexcept {
        if (priority != other.priority) return priority > other.priority;
        return begin != other.begin ? begin < other.begin : size > other.size;
    }
};

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

Workspace workspace_in(Samples& storage) {
    const std::size_t n = storage.size() / 2;
    return {storage.all().part(0, n), storage.all().part(n, 2 * n)};
}

/// Splits `node` in two. @return left and right.
std::pair<ClusterNode, ClusterNode> split(const ClusterNode& node, const Workspace& space) {
    const MutableSampleSpan samples = space.samples.part(node.begin, node.end);
    const SplitPlane plane = split_plane(node.moments);
    auto front = static_cast<Index>(
        cluster_kernels().partition(samples, plane, space.scratch.part(node.begin, node.end)));
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
    return moments_about(samples, {samples.x[0], samples.y[0], samples.z[0]});
}

ClusterTree::ClusterTree(std::span<const Vec3f> points, const RunContext& context)
    : size_(points.size()), storage_(2 * points.size()) {
    assert(!points.empty());
    const MutableSampleSpan samples = workspace_in(storage_).samples;
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

ClusterTree::ClusterTree(std::span<const Vec3f> points, const Clusters& clusters,
                         const RunContext& context)
    : size_(points.size()),
      roots_(static_cast<Index>(clusters.size())),
      storage_(2 * points.size()),
      nodes_(clusters.size()) {
    assert(!points.empty() && clusters.members.size() == points.size());
    const MutableSampleSpan samples = workspace_in(storage_).samples;
    parallel_for_blocks(nodes_.size(), 256, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t c = begin; c < end; ++c) {
            ClusterNode& root = nodes_[c];
            root.begin = clusters.offsets[c];
            root.end = clusters.offsets[c + 1];
            for (Index at = root.begin; at < root.end; ++at) {
                const Vec3f& p = points[clusters.members[at]];
                samples.x[at] = p.x();
                samples.y[at] = p.y();
                samples.z[at] = p.z();
                samples.index[at] = clusters.members[at];
            }
            root.moments = moments_of(samples.part(root.begin, root.end));
            root.priority = priority_of(root);
        }
    });
}

void ClusterTree::grow(const std::function<bool(const ClusterNode&)>& wanted,
                       const RunContext& context) {
    std::vector<Index> open;
    for (Index id = 0; id < nodes_.size(); ++id) {
        if (!nodes_[id].is_split() && nodes_[id].can_split() && wanted(nodes_[id]))
            open.push_back(id);
    }
    const Workspace space = workspace_in(storage_);
    if (context.thread_count() == 1) {
        for (const Index id : open) grow_here(nodes_, id, space, wanted, context);
        return;
    }
    std::vector<std::vector<ClusterNode>> branches(open.size());
    with_threads(context, [&] {
        tbb::parallel_for(std::size_t{0}, open.size(), [&](std::size_t i) {
            branches[i] = grow_branch(nodes_[open[i]], space, wanted, context);
        });
    });
    for (std::size_t i = 0; i < open.size(); ++i) graft(nodes_, open[i], std::move(branches[i]));
}

Cut ClusterTree::cut(std::uint64_t size, const RunContext& context) {
    assert(size >= roots_ && size <= size_);
    if (roots_ == 1) {
        // Most clusters larger than the average will be split: grow those at once, depth first,
        // while they are in the cache.
        nodes_.reserve(4 * size);
        const double likely = 1.5 * static_cast<double>(size_) / static_cast<double>(size);
        grow([likely](const ClusterNode& node) { return node.size() > likely; }, context);
    }
    const std::size_t splits = size - roots_;
    std::vector<Ranked> chosen;
    const auto consider = [&](std::size_t first_node) {
        for (std::size_t id = first_node; id < nodes_.size(); ++id) {
            const ClusterNode& node = nodes_[id];
            if (node.can_split()) {
                chosen.push_back({node.priority, node.begin, node.size(), static_cast<Index>(id)});
            }
        }
        if (chosen.size() <= splits) return;
        std::nth_element(chosen.begin(), chosen.begin() + static_cast<std::ptrdiff_t>(splits),
                         chosen.end());
        chosen.resize(splits);
    };
    consider(0);
    while (true) {
        std::vector<Index> leaves;
        for (const Ranked& ranked : chosen) {
            if (!nodes_[ranked.id].is_split()) leaves.push_back(ranked.id);
        }
        if (leaves.empty()) break;
        const std::size_t old_size = nodes_.size();
        split_leaves(leaves, context);
        consider(old_size);  // the children may take the place of others, never of their parents
    }
    std::vector<char> is_chosen(nodes_.size());
    for (const Ranked& ranked : chosen) is_chosen[ranked.id] = 1;
    return cut_where([&](Index id) { return is_chosen[id] != 0; });
}

void ClusterTree::split_leaves(std::vector<Index> leaves, const RunContext& context) {
    std::ranges::sort(leaves);
    const std::size_t old_size = nodes_.size();
    nodes_.resize(old_size + 2 * leaves.size());
    parallel_for_blocks(leaves.size(), 64, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            ClusterNode& node = nodes_[leaves[i]];
            node.left = static_cast<Index>(old_size + 2 * i);
            node.right = node.left + 1;
            std::tie(nodes_[node.left], nodes_[node.right]) = split(node, workspace_in(storage_));
        }
    });
}

Cut ClusterTree::leaves() const {
    return cut_where([this](Index id) { return nodes_[id].is_split(); });
}

Cut ClusterTree::cut_where(const std::function<bool(Index)>& descends) const {
    Cut cut;
    std::vector<Index> open(roots_);
    std::iota(open.rbegin(), open.rend(), Index{0});
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
    cut.offsets.push_back(static_cast<Index>(size_));
    return cut;
}

}  // namespace stipple
