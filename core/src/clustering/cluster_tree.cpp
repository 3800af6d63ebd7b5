#include "clustering/cluster_tree.hpp"

#include "base/first_touch.hpp"
#include "base/large_memory.hpp"
#include "base/parallel_for.hpp"
#include "base/progress_for.hpp"
#include "base/until_stopped.hpp"
#include "clustering/gather.hpp"
#include "clustering/large_split.hpp"
#include "clustering/layers.hpp"
#include "clustering/sample_moments.hpp"

#include <tbb/task_group.h>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <functional>
#include <mutex>
#include <numeric>
#include <utility>

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

using Nodes = std::pmr::vector<ClusterNode>;

constexpr std::size_t kParallelGrain = 8'192;   // points below which a subtree is one task
constexpr std::size_t kBetweenChecks = 65'536;  // nodes
constexpr double kUnknown = std::numeric_limits<double>::max();  // priority of a root

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
void add_halves(Nodes& nodes, Index id, Index left_size, const std::array<float, 3>& reference) {
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
void graft(Nodes& nodes, std::span<const Index> leaves, std::span<const ClusterNode> grown) {
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
    Index place = 0;         ///< where its points begin
    bool in_second = false;  ///< which half of the storage holds them
    SampleMoments moments;
};

/// The points of some nodes, whose subtrees grow there.
class Residence {
public:
    /// @param members  of the whole tree.
    /// @param room  for the points of the nodes, twice.
    Residence(std::span<const Vec3f> points, std::span<Index> members,
              const MutableSampleSpan& room, const SplitRule& rule, SplitPriority priority,
              const RunContext& context)
        : points_(points),
          members_(members),
          room_(room),
          rule_(rule),
          priority_(priority),
          context_(context) {}

    /// Adds what grows below the nodes, and puts their members in order.
    void grow(Nodes& nodes) {
        std::vector<Open> small, large;
        Index place = 0;
        for (Index id = 0; id < nodes.size(); ++id) {
            const ClusterNode& node = nodes[id];
            const MutableSampleSpan samples = part(false, place, node.size);
            gather(points_, members_.subspan(node.begin, node.size), samples);
            (is_task(node) ? small : large)
                .push_back({id, place, false, moments_about(samples, node.reference)});
            place += node.size;
        }
        for (const Open& top : large) grow_in_parallel(nodes, top);
        grow_here(nodes, std::move(small));
    }

private:
    MutableSampleSpan part(bool second, Index place, Index size) {
        const std::size_t begin = (second ? room_.size / 2 : 0) + place;
        return room_.part(begin, begin + size);
    }

    /// Whether its subtree is grown by one thread.
    bool is_task(const ClusterNode& node) const {
        return node.size <= kParallelGrain || context_.thread_count() == 1;
    }

    /// Splits the node where it is wanted, and adds its halves to `open`.
    void visit(Nodes& nodes, const Open& top, const Spread& spread, std::vector<Open>& open) {
        ClusterNode& node = nodes[top.id];
        node.priority = std::min(node.priority, priority_(top.moments, spread));
        const std::span<Index> members = members_.subspan(node.begin, node.size);
        const SampleSpan from = part(top.in_second, top.place, node.size);
        if (!rule_.wants(node, variation_of(top.moments, spread))) {
            std::copy_n(from.index, from.size, members.data());
            return;
        }
        if (node.size > kParallelGrain) context_.throw_if_stopped();
        const SplitPlane plane = plane_between_layers(from, top.moments, spread)
                                     .value_or(split_plane(top.moments, spread));
        const MutableSampleSpan to = part(!top.in_second, top.place, node.size);
        auto front = static_cast<Index>(cluster_kernels().partition(from, plane, to));
        if (front == 0 || front == node.size) {
            std::copy_n(from.index, from.size, members.data());
            front = halve(points_, members);
            gather(points_, members, to);
        }
        add_halves(nodes, top.id, front, plane.reference);
        Index place = top.place;
        for (auto id = static_cast<Index>(nodes.size() - 2); id < nodes.size(); ++id) {
            const SampleSpan samples = part(!top.in_second, place, nodes[id].size);
            if (nodes[id].can_split())
                open.push_back(
                    {id, place, !top.in_second, moments_about(samples, plane.reference)});
            else
                members_[nodes[id].begin] = *samples.index;
            place += nodes[id].size;
        }
    }

    void grow_here(Nodes& nodes, std::vector<Open> open) {
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

    void grow_in_parallel(Nodes& nodes, const Open& top) {
        if (is_task(nodes[top.id])) return grow_here(nodes, {top});
        const auto spreads = cluster_kernels().spreads({top.moments.scatter, {}, {}, {}});
        std::vector<Open> open;
        visit(nodes, top, spreads[0], open);
        if (open.size() < 2) return grow_here(nodes, std::move(open));

        Nodes right_branch = {nodes[open[1].id]};
        tbb::task_group group;
        group.run([&] {
            Open right = open[1];
            right.id = 0;
            grow_in_parallel(right_branch, right);
        });
        std::exception_ptr failure;
        try {
            grow_in_parallel(nodes, open[0]);
        } catch (...) {
            failure = std::current_exception();
        }
        group.wait();  // always: the task refers to this frame
        if (failure) std::rethrow_exception(failure);
        graft(nodes, std::span(&open[1].id, 1), right_branch);
    }

    std::span<const Vec3f> points_;
    std::span<Index> members_;
    MutableSampleSpan room_;
    const SplitRule& rule_;
    SplitPriority priority_;
    const RunContext& context_;
};

/// The first `count` of some ranks, at least one, with the last of them at the end.
void keep_first(std::vector<SplitRank>& ranks, std::size_t count, const RunContext& context) {
    std::nth_element(ranks.begin(), ranks.begin() + static_cast<std::ptrdiff_t>(count - 1),
                     ranks.end(), until_stopped(context, std::less<>()));
    ranks.resize(count);
}

/// Rooms of one size, each used by one job after the other: new memory takes as long to get as a
/// third of what is done in it.
class Rooms {
public:
    explicit Rooms(std::size_t samples) : samples_(samples) {}

    template <typename Use>
    void use(Use&& use) {
        Samples room = take();
        use(room.all());
        const std::lock_guard lock(mutex_);
        free_.push_back(std::move(room));
    }

private:
    Samples take() {
        const std::lock_guard lock(mutex_);
        if (free_.empty()) return Samples(samples_);
        Samples room = std::move(free_.back());
        free_.pop_back();
        return room;
    }

    std::size_t samples_;
    std::mutex mutex_;
    std::vector<Samples> free_;
};

ClusterNode root_of(std::span<const Vec3f> points, std::span<const Index> members, Index begin) {
    ClusterNode root;
    root.begin = begin;
    root.size = static_cast<Index>(members.size());
    root.reference = as_array(points[members.front()]);
    root.priority = kUnknown;
    return root;
}

bool is_resident(std::size_t points) noexcept {
    return points <= kResident;
}

std::size_t bytes_for(std::size_t points) noexcept {
    const std::size_t members = points * sizeof(Index);
    if (!is_resident(points)) return members;
    constexpr std::size_t kPointsPerNode = 4;  // of most cuts; room for more is had where needed
    return 2 * points * kSampleBytes + members + points / kPointsPerNode * sizeof(ClusterNode);
}

}  // namespace

ClusterTree::ClusterTree(std::span<const Vec3f> points, SplitPriority priority)
    : points_(points),
      memory_(bytes_for(points.size()), &large_memory_resource()),
      nodes_(is_resident(points.size()) ? &memory_ : &large_memory_resource()),
      priority_(priority) {
    assert(!points.empty());
    const auto room_for = [&](std::size_t bytes) { return memory_.allocate(bytes, sizeof(Index)); };
    if (is_resident(points.size()))
        room_ = samples_in(room_for(2 * points.size() * kSampleBytes), 2 * points.size());
    members_ = {static_cast<Index*>(room_for(points.size() * sizeof(Index))), points.size()};
}

ClusterTree::ClusterTree(std::span<const Vec3f> points, const Clusters& roots)
    : ClusterTree(points, width_of_cluster) {
    std::ranges::copy(roots.members, members_.begin());
    roots_ = static_cast<Index>(roots.size());
    nodes_.reserve(roots.size());
    for (std::size_t i = 0; i < roots.size(); ++i)
        nodes_.push_back(root_of(points, roots.of(i), roots.offsets[i]));
}

/// One root with all points.
void ClusterTree::plant(const RunContext& context) {
    parallel_for_blocks(members_.size(), 65'536, context, [&](std::size_t begin, std::size_t end) {
        std::iota(members_.begin() + static_cast<std::ptrdiff_t>(begin),
                  members_.begin() + static_cast<std::ptrdiff_t>(end), static_cast<Index>(begin));
    });
    nodes_.push_back(root_of(points_, members_, 0));
}

void ClusterTree::grow(const SplitRule& rule, const RunContext& context) {
    assert(nodes_.size() <= roots_);
    if (nodes_.empty()) plant(context);
    constexpr double kSplit = 0.4;
    if (!is_resident(points_.size())) split_large(rule, context.part(0, kSplit));
    grow_leaves(rule, context.part(kSplit, 1));
}

void ClusterTree::split_large(const SplitRule& rule, const RunContext& context) {
    struct Large {
        Index id;
        SampleMoments moments;
    };
    std::vector<Large> open;
    for (Index id = 0; id < roots_; ++id) {
        const ClusterNode& root = nodes_[id];
        if (is_resident(root.size)) continue;
        const std::span<const Index> members = members_.subspan(root.begin, root.size);
        open.push_back({id, moments_of_many(points_, members, root.reference, context)});
    }
    if (open.empty()) return;
    LargeArray<Index> memory(points_.size());
    const std::span room(memory);
    const double all = static_cast<double>(points_.size());
    const double rounds = std::log2(all / kResident) + 1;  // in which every point is looked at
    double seen = 0;
    while (!open.empty()) {
        const auto [id, moments] = open.back();
        open.pop_back();
        context.checkpoint(std::min(1.0, seen / (rounds * all)));
        seen += static_cast<double>(nodes_[id].size);
        const Spread spread = cluster_kernels().spreads({moments.scatter, {}, {}, {}})[0];
        ClusterNode& node = nodes_[id];
        node.priority = std::min(node.priority, priority_(moments, spread));
        if (node.size <= kResident || !rule.wants(node, variation_of(moments, spread))) continue;
        const SplitPlane plane = split_plane(moments, spread);
        const std::span<Index> members = std::span(members_).subspan(node.begin, node.size);
        Sides sides =
            partition_many(points_, members, plane, room.subspan(node.begin, node.size), context);
        if (sides.left.count == 0 || sides.right.count == 0) {
            const Index front = halve(points_, members);
            sides.left = moments_of_many(points_, members.first(front), plane.reference, context);
            sides.right =
                moments_of_many(points_, members.subspan(front), plane.reference, context);
        }
        for (SampleMoments* const side : {&sides.left, &sides.right}) {
            const bool is_left = side == &sides.left;
            const auto nearer = nearer_reference(*side, plane.reference);
            if (!nearer) continue;
            *side = moments_of_many(
                points_, is_left ? members.first(side->count) : members.last(side->count), *nearer,
                context);
        }
        add_halves(nodes_, id, static_cast<Index>(sides.left.count), plane.reference);
        open.push_back({nodes_[id].left + 1, sides.right});
        open.push_back({nodes_[id].left, sides.left});
    }
}

void ClusterTree::grow_leaves(const SplitRule& rule, const RunContext& context) {
    const auto grow_in = [&](const MutableSampleSpan& room, Nodes& nodes) {
        Residence(points_, members_, room, rule, priority_, context).grow(nodes);
    };
    const auto nodes_of = [&](std::size_t points) {  // leaves of 3/4 of the bound, so much for each
        const double leaves = 4 * static_cast<double>(points) / (3 * rule.max_size);
        return rule.max_size < kResident ? static_cast<std::size_t>(2 * leaves + 64) : 0;
    };
    if (nodes_.size() == 1 && is_resident(points_.size())) {
        const std::size_t most = 2 * points_.size();
        nodes_.reserve(std::min(most, 2 * nodes_of(points_.size())));  // a cut adds to them
        return with_threads(context, [&] { grow_in(room_, nodes_); });
    }
    // Leaves are grown in jobs of at least so many points.
    struct Job {
        std::size_t begin = 0, end = 0, place = 0, points = 0;
    };
    std::vector<Index> leaves;
    std::vector<Job> jobs;
    std::size_t place = 0;
    for (Index id = 0; id < nodes_.size(); ++id) {
        if (id % kBetweenChecks == 0) context.throw_if_stopped();
        const ClusterNode& node = nodes_[id];
        if (node.is_split() || node.size > kResident) continue;
        if (node.priority != kUnknown && !rule.may_want(node)) continue;
        if (jobs.empty() || jobs.back().points >= kParallelGrain)
            jobs.push_back({.begin = leaves.size(), .place = place});
        leaves.push_back(id);
        jobs.back().end = leaves.size();
        jobs.back().points += node.size;
        place += node.size;
    }
    std::size_t largest = 0;
    for (const Job& job : jobs) largest = std::max(largest, job.points);
    Rooms rooms(2 * largest);
    const auto grow_job = [&](const Job& job, Nodes& nodes) {
        nodes.clear();
        nodes.reserve(nodes_of(job.points));
        for (std::size_t i = job.begin; i < job.end; ++i) nodes.push_back(nodes_[leaves[i]]);
        if (room_.size > 0)
            return grow_in(room_.part(2 * job.place, 2 * (job.place + job.points)), nodes);
        rooms.use(
            [&](const MutableSampleSpan& room) { grow_in(room.part(0, 2 * job.points), nodes); });
    };
    // Some at a time, in memory that is used again: new memory takes longer than to copy nodes.
    const auto make_room = [&](const Job& job, std::size_t more) {
        const std::size_t needed = nodes_.size() + more;
        if (needed <= nodes_.capacity()) return;
        constexpr double kAsMany = 1.5;  // for the points to come; what is not used costs nothing
        const double likely = kAsMany * static_cast<double>(more) / static_cast<double>(job.points);
        const double to_come = likely * static_cast<double>(place - job.place);
        reserve_in_blocks(
            nodes_, std::max(needed, nodes_.size() + static_cast<std::size_t>(to_come)), context);
    };
    std::vector<Nodes> grown;
    for (std::size_t first = 0, last = 0; first < jobs.size(); first = last) {
        const std::size_t most = jobs[first].place + kResident * context.thread_count();
        while (last < jobs.size() &&
               (last == first || jobs[last].place + jobs[last].points <= most))
            ++last;
        while (grown.size() < last - first) grown.emplace_back(&large_memory_resource());
        const auto reached = [&](std::size_t job) {
            return job < jobs.size()
                       ? static_cast<double>(jobs[job].place) / static_cast<double>(place)
                       : 1.0;
        };
        with_threads(context, [&] {
            parallel_for_blocks_with_progress(
                last - first, 1, context.part(reached(first), reached(last)),
                [&](std::size_t i, std::size_t) { grow_job(jobs[first + i], grown[i]); });
        });
        for (std::size_t j = first; j < last; ++j) {
            context.throw_if_stopped();
            make_room(jobs[j], grown[j - first].size());
            graft(nodes_, std::span(leaves).subspan(jobs[j].begin, jobs[j].end - jobs[j].begin),
                  grown[j - first]);
        }
    }
}

Cut ClusterTree::cut(std::uint64_t size, const RunContext& context) {
    return std::move(cuts({&size, 1}, context).front());
}

std::vector<Cut> ClusterTree::cuts(std::span<const std::uint64_t> sizes,
                                   const RunContext& context) {
    std::vector<Cut> cuts;
    std::vector<SplitRank> splits;  // of the cut before: those of the next are among them
    for (const std::uint64_t size : sizes) {
        assert(size >= roots_ && size <= points_.size());
        // Most clusters larger than the average will be split.
        if (nodes_.size() <= roots_) {
            const double likely =
                1.5 * static_cast<double>(points_.size()) / static_cast<double>(size);
            grow({.max_size = std::min<double>(likely, kResident)}, context);
        }
        if (size == roots_) {
            cuts.push_back(cut_where([](const ClusterNode&) { return false; }, size, context));
            continue;
        }
        if (splits.empty())
            splits = first_splits(size - roots_, context.quietly());
        else
            keep_first(splits, size - roots_, context);
        const auto is_above = [last = splits.back()](const ClusterNode& node) {
            return node.is_split() && !(last < node.rank());
        };
        cuts.push_back(cut_where(is_above, size, context));
    }
    return cuts;
}

/// The nodes that the queue splits, first among those known, until none of them is a leaf; the last
/// of them at the end.
std::vector<SplitRank> ClusterTree::first_splits(std::size_t count, const RunContext& context) {
    std::vector<SplitRank> chosen;
    reserve_in_blocks(chosen, nodes_.size(), context);
    for (std::size_t known = 0; known < nodes_.size();) {
        for_blocks_in_order(nodes_.size() - known, context,
                            [&](std::size_t begin, std::size_t end) {
                                for (const ClusterNode& node :
                                     std::span(nodes_).subspan(known + begin, end - begin))
                                    if (node.can_split()) chosen.push_back(node.rank());
                            });
        known = nodes_.size();
        keep_first(chosen, std::min(count, chosen.size()), context);
        grow_leaves({.last = chosen.back()}, context);
    }
    return chosen;
}

void ClusterTree::forget_nodes() noexcept {
    Nodes(nodes_.get_allocator()).swap(nodes_);
}

Cut ClusterTree::leaves(const RunContext& context) const {
    return cut_where([](const ClusterNode& node) { return node.is_split(); },
                     (nodes_.size() + roots_) / 2, context);
}

template <typename Descends>
Cut ClusterTree::cut_where(const Descends& descends, std::size_t clusters,
                           const RunContext& context) const {
    constexpr Index kInner = 0;
    Cut cut;
    cut.offsets.reserve(clusters + 1);
    cut.clusters_of.reserve(2 * clusters);
    std::vector<Index> open(roots_);
    std::iota(open.rbegin(), open.rend(), Index{0});
    while (!open.empty()) {
        if (cut.clusters_of.size() % kBetweenChecks == 0) context.throw_if_stopped();
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
        if (i % kBetweenChecks == 0) context.throw_if_stopped();
        if (cut.clusters_of[i] != kInner) continue;
        const Index left = cut.clusters_of[i + 1];
        cut.clusters_of[i] = left + cut.clusters_of[i + 2 * std::size_t{left}];
    }
    return cut;
}

}  // namespace stipple
