#include "cluster_tree.hpp"

#include "gather.hpp"
#include "large_split.hpp"
#include "parallel_for.hpp"
#include "sample_moments.hpp"

#include <tbb/task_group.h>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>

// Follows: Pauly, Gross, Kobbelt 2002, §3.1; Shaffer and Garland 2001 (the same partition with a
// queue, for meshes).
//
// A node of at most `kResident` points is copied to where eight coordinates lie side by side, and
// its subtree is grown there: a pass moves the points of a cluster to either side, another takes
// the moments of each half while they are in the cache. Larger nodes are split by large_split.cpp.
// Moments are sums of differences to a point near the cluster, in floats over a few samples and in
// doubles over all. Nothing is derived from a parent's sums, so rounding does not build up towards
// the leaves.
//
// The priority queue is not there: a child's priority is never above its parent's, so the first
// splits of the queue, one fewer than the clusters wanted, are as many nodes of highest priority.
// That lets subtrees grow on their own threads, and any number of cuts be read off one tree.

namespace stipple {

namespace {

constexpr Index kResident = 262'144;
constexpr std::size_t kParallelGrain = 8'192;  // points below which a subtree is one task

std::array<float, 3> as_array(const Vec3f& v) {
    return {v.x(), v.y(), v.z()};
}

/// Where rounding leaves all points on one side of a plane: puts them in their order along the
/// longest axis of their box. @return half of them.
Index halve(std::span<const Vec3f> points, std::span<Index> numbers) {
    Vec3f low = points[numbers.front()], high = low;
    for (const Index i : numbers) {
        low = low.cwiseMin(points[i]);
        high = high.cwiseMax(points[i]);
    }
    int axis = 0;
    (high - low).maxCoeff(&axis);
    std::ranges::sort(numbers, {}, [&](Index i) { return std::pair(points[i][axis], i); });
    return static_cast<Index>(numbers.size() / 2);
}

/// Adds the halves of a node to the others, left first.
void add_halves(std::vector<ClusterNode>& nodes, Index id, Index left_size,
                const std::array<float, 3>& reference) {
    ClusterNode left = nodes[id];
    nodes[id].left = static_cast<Index>(nodes.size());
    left.reference = reference;
    ClusterNode right = left;
    left.size = left_size;
    right.begin += left_size;
    right.size -= left_size;
    nodes.push_back(left);
    nodes.push_back(right);
}

/// Puts subtrees in place of leaves: their roots come first in `grown`.
void graft(std::vector<ClusterNode>& nodes, std::span<const Index> leaves,
           std::span<const ClusterNode> grown) {
    const auto shift = static_cast<Index>(nodes.size() - leaves.size());
    for (std::size_t i = 0; i < grown.size(); ++i) {
        ClusterNode node = grown[i];
        if (node.is_split()) node.left += shift;
        if (i < leaves.size())
            nodes[leaves[i]] = node;
        else
            nodes.push_back(node);
    }
}

/// A node whose points are resident and whose moments are known.
struct Open {
    Index id = 0;
    bool in_second = false;  ///< which half of the storage holds its points
    SampleMoments moments;
};

/// Grows subtrees of at most `capacity` points, one at a time.
class Residence {
public:
    Residence(std::span<const Vec3f> points, std::size_t capacity, const SplitRule& rule,
              const RunContext& context)
        : points_(points),
          capacity_(capacity),
          storage_(2 * capacity),
          rule_(rule),
          context_(context) {}

    /// Adds what grows below a node, and puts its members in order.
    void grow(std::vector<ClusterNode>& nodes, Index id, std::span<Index> members) {
        base_ = nodes[id].begin;
        members_ = members;
        const MutableSampleSpan samples = half(false).part(0, members.size());
        gather(points_, members, samples);
        grow_from(nodes, {id, false, moments_about(samples, nodes[id].reference)});
    }

private:
    MutableSampleSpan half(bool second) {
        return second ? storage_.all().part(capacity_, 2 * capacity_)
                      : storage_.all().part(0, capacity_);
    }

    void grow_from(std::vector<ClusterNode>& nodes, const Open& top) {
        if (nodes[top.id].size <= kParallelGrain || context_.thread_count() == 1)
            grow_here(nodes, top);
        else
            grow_in_parallel(nodes, top);
    }

    /// Splits the node where it is wanted, and adds its halves to `open`.
    void visit(std::vector<ClusterNode>& nodes, const Open& top, const Spread& spread,
               std::vector<Open>& open) {
        ClusterNode& node = nodes[top.id];
        node.priority = std::min(node.priority, gain_of_split(top.moments, spread));
        const std::size_t begin = node.begin - base_, end = begin + node.size;
        const MutableSampleSpan from = half(top.in_second).part(begin, end),
                                to = half(!top.in_second).part(begin, end);
        if (!rule_.wants(node, variation_of(top.moments, spread))) {
            std::copy_n(from.index, from.size, members_.data() + begin);
            return;
        }
        if (node.size > kParallelGrain) context_.throw_if_stopped();
        const SplitPlane plane = split_plane(top.moments, spread);
        auto front = static_cast<Index>(cluster_kernels().partition(from, plane, to));
        if (front == 0 || front == node.size) {
            const std::span<Index> members = members_.subspan(begin, from.size);
            std::copy_n(from.index, from.size, members.data());
            front = halve(points_, members);
            gather(points_, members, to);
        }
        add_halves(nodes, top.id, front, plane.reference);
        for (std::size_t id = nodes.size() - 2; id < nodes.size(); ++id) {
            const std::size_t at = nodes[id].begin - base_;
            if (nodes[id].can_split())
                open.push_back({static_cast<Index>(id), !top.in_second,
                                moments_about(half(!top.in_second).part(at, at + nodes[id].size),
                                              plane.reference)});
            else
                members_[at] = half(!top.in_second).index[at];
        }
    }

    void grow_here(std::vector<ClusterNode>& nodes, const Open& top) {
        std::vector<Open> open = {top};
        std::array<Open, kSpreads> batch;
        std::array<Symmetric3, kSpreads> scatters;
        while (!open.empty()) {
            const std::size_t count = std::min(open.size(), kSpreads);
            for (std::size_t i = 0; i < count; ++i) {
                batch[i] = open.back();
                scatters[i] = batch[i].moments.scatter;
                open.pop_back();
            }
            const auto spreads = cluster_kernels().spreads(scatters);
            for (std::size_t i = 0; i < count; ++i) visit(nodes, batch[i], spreads[i], open);
        }
    }

    void grow_in_parallel(std::vector<ClusterNode>& nodes, const Open& top) {
        const auto spreads = cluster_kernels().spreads({top.moments.scatter, {}, {}, {}});
        std::vector<Open> open;
        visit(nodes, top, spreads[0], open);
        if (open.size() < 2) {
            for (const Open& only : open) grow_from(nodes, only);
            return;
        }
        std::vector<ClusterNode> right_branch = {nodes[open[1].id]};
        const Open right = {0, open[1].in_second, open[1].moments};
        tbb::task_group group;
        group.run([&] { grow_from(right_branch, right); });
        std::exception_ptr failure;
        try {
            grow_from(nodes, open[0]);
        } catch (...) {
            failure = std::current_exception();
        }
        group.wait();  // always: the task refers to this frame
        if (failure) std::rethrow_exception(failure);
        graft(nodes, std::span(&open[1].id, 1), right_branch);
    }

    std::span<const Vec3f> points_;
    std::size_t capacity_;
    Samples storage_;
    const SplitRule& rule_;
    const RunContext& context_;
    std::span<Index> members_;
    Index base_ = 0;
};

}  // namespace

ClusterTree::ClusterTree(std::span<const Vec3f> points) : points_(points), members_(points.size()) {
    assert(!points.empty());
}

void ClusterTree::grow(const SplitRule& rule, const RunContext& context) {
    assert(nodes_.empty());
    parallel_for_blocks(members_.size(), 65'536, context, [&](std::size_t begin, std::size_t end) {
        std::iota(members_.begin() + static_cast<std::ptrdiff_t>(begin),
                  members_.begin() + static_cast<std::ptrdiff_t>(end), static_cast<Index>(begin));
    });
    ClusterNode root;
    root.size = static_cast<Index>(points_.size());
    root.reference = as_array(points_.front());
    root.priority = std::numeric_limits<double>::max();
    nodes_.push_back(root);
    if (root.size > kResident) split_large(rule, context);
    grow_leaves(rule, context);
}

void ClusterTree::split_large(const SplitRule& rule, const RunContext& context) {
    std::vector<Index> room(points_.size());
    struct Large {
        Index id;
        SampleMoments moments;
    };
    std::vector<Large> open = {
        {0, moments_of_many(points_, members_, nodes_.front().reference, context)}};
    while (!open.empty()) {
        const auto [id, moments] = open.back();
        open.pop_back();
        const Spread spread = cluster_kernels().spreads({moments.scatter, {}, {}, {}})[0];
        ClusterNode& node = nodes_[id];
        node.priority = std::min(node.priority, gain_of_split(moments, spread));
        if (node.size <= kResident || !rule.wants(node, variation_of(moments, spread))) continue;
        const SplitPlane plane = split_plane(moments, spread);
        const std::span<Index> members = std::span(members_).subspan(node.begin, node.size);
        Sides sides = partition_many(points_, members, plane,
                                     std::span(room).subspan(node.begin, node.size), context);
        if (sides.left.count == 0 || sides.right.count == 0) {
            const Index front = halve(points_, members);
            sides.left = moments_of_many(points_, members.first(front), plane.reference, context);
            sides.right =
                moments_of_many(points_, members.subspan(front), plane.reference, context);
        }
        add_halves(nodes_, id, static_cast<Index>(sides.left.count), plane.reference);
        open.push_back({nodes_[id].left + 1, sides.right});
        open.push_back({nodes_[id].left, sides.left});
    }
}

void ClusterTree::grow_leaves(const SplitRule& rule, const RunContext& context) {
    // Leaves are grown in jobs of at least so many points.
    struct Job {
        std::size_t begin = 0, end = 0, largest = 0, points = 0;
    };
    std::vector<Index> leaves;
    std::vector<Job> jobs;
    for (Index id = 0; id < nodes_.size(); ++id) {
        const ClusterNode& node = nodes_[id];
        if (node.is_split() || node.size > kResident || !rule.may_want(node)) continue;
        if (jobs.empty() || jobs.back().points >= kParallelGrain)
            jobs.push_back({.begin = leaves.size()});
        leaves.push_back(id);
        jobs.back().end = leaves.size();
        jobs.back().largest = std::max<std::size_t>(jobs.back().largest, node.size);
        jobs.back().points += node.size;
    }
    std::vector<std::vector<ClusterNode>> grown(jobs.size());
    parallel_for_blocks(jobs.size(), 1, context, [&](std::size_t j, std::size_t) {
        const Job& job = jobs[j];
        if (rule.max_size < kResident) {  // leaves of 3/4 of the bound, so much for each
            grown[j].reserve(static_cast<std::size_t>(
                3.0 * static_cast<double>(job.points) / rule.max_size + 64.0));
        }
        Residence residence(points_, job.largest, rule, context);
        for (std::size_t i = job.begin; i < job.end; ++i) grown[j].push_back(nodes_[leaves[i]]);
        for (Index root = 0; root < job.end - job.begin; ++root) {
            const ClusterNode leaf = grown[j][root];
            residence.grow(grown[j], root, std::span(members_).subspan(leaf.begin, leaf.size));
        }
    });
    std::size_t total = nodes_.size();
    for (std::size_t j = 0; j < jobs.size(); ++j)
        total += grown[j].size() - (jobs[j].end - jobs[j].begin);
    nodes_.reserve(total);
    for (std::size_t j = 0; j < jobs.size(); ++j) {
        graft(nodes_, std::span(leaves).subspan(jobs[j].begin, jobs[j].end - jobs[j].begin),
              grown[j]);
        std::vector<ClusterNode>().swap(grown[j]);
    }
}

Cut ClusterTree::cut(std::uint64_t size, const RunContext& context) {
    assert(size >= 1 && size <= points_.size());
    // Most clusters larger than the average will be split.
    if (nodes_.empty()) {
        const double likely = 1.5 * static_cast<double>(points_.size()) / static_cast<double>(size);
        grow({.max_size = std::min<double>(likely, kResident)}, context);
    }
    if (size == 1) return {{0, static_cast<Index>(points_.size())}, {1}};

    // The nodes that the queue splits, first among those known, until none of them is a leaf.
    std::vector<SplitRank> chosen;
    std::size_t known = 0;
    while (true) {
        for (; known < nodes_.size(); ++known) {
            if (nodes_[known].can_split()) chosen.push_back(nodes_[known].rank());
        }
        const std::size_t splits = std::min<std::size_t>(size - 1, chosen.size());
        std::nth_element(chosen.begin(), chosen.begin() + static_cast<std::ptrdiff_t>(splits - 1),
                         chosen.end());
        chosen.resize(splits);
        const SplitRule rule{.last = chosen.back()};
        grow_leaves(rule, context);
        if (nodes_.size() > known) continue;
        return cut_where([&rule](const ClusterNode& node) {
            return node.is_split() && !(rule.last < node.rank());
        });
    }
}

Cut ClusterTree::leaves() const {
    return cut_where([](const ClusterNode& node) { return node.is_split(); });
}

template <typename Descends>
Cut ClusterTree::cut_where(const Descends& descends) const {
    constexpr Index kInner = 0;
    Cut cut;
    std::vector<Index> open = {0};
    while (!open.empty()) {
        const ClusterNode& node = nodes_[open.back()];
        open.pop_back();
        if (descends(node)) {
            open.push_back(node.left + 1);
            open.push_back(node.left);
            cut.clusters_of.push_back(kInner);
        } else {
            cut.offsets.push_back(node.begin);
            cut.clusters_of.push_back(1);
        }
    }
    cut.offsets.push_back(static_cast<Index>(points_.size()));
    for (std::size_t i = cut.clusters_of.size(); i-- > 0;) {
        if (cut.clusters_of[i] != kInner) continue;
        const Index left = cut.clusters_of[i + 1];
        cut.clusters_of[i] = left + cut.clusters_of[i + 2 * std::size_t{left}];
    }
    return cut;
}

}  // namespace stipple
