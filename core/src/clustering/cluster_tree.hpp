#pragma once

#include "cloud/samples.hpp"
#include "clustering/sample_moments.hpp"
#include "stipple/clusters.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <array>
#include <cstdint>
#include <limits>
#include <memory_resource>
#include <span>
#include <vector>

namespace stipple {

/// The most points whose coordinates lie side by side while a subtree grows.
constexpr Index kResident = 262'144;

/// A node in the order of splitting, a total order in which a parent stands before its children.
struct SplitRank {
    double priority = 0;
    Index begin = 0, size = 0;

    bool operator<(const SplitRank& other) const noexcept {
        if (priority != other.priority) return priority > other.priority;
        return begin != other.begin ? begin < other.begin : size > other.size;
    }
};

/// A node of the binary space partition: the members `begin .. begin + size` of the tree.
struct ClusterNode {
    Index begin = 0, size = 0;
    Index left = 0;  ///< its children are this one and the next; 0 when not split yet
    std::array<float, 3> reference{};  ///< near its points; what its sums are relative to
    double priority = 0;               ///< the larger is split first; never above the parent's

    bool is_split() const noexcept { return left != 0; }
    bool can_split() const noexcept { return size > 1; }
    SplitRank rank() const noexcept { return {priority, begin, size}; }
};

/// Which clusters are split: those of two points or more for which any of the three says so.
struct SplitRule {
    double max_size = std::numeric_limits<double>::infinity();         ///< more points than these
    double max_variation = std::numeric_limits<double>::infinity();    ///< more surface variation
    SplitRank last = {std::numeric_limits<double>::infinity(), 0, 0};  ///< up to this rank

    bool wants(const ClusterNode& node, double variation) const noexcept {
        return node.can_split() &&
               (node.size > max_size || variation > max_variation || !(last < node.rank()));
    }
    /// Whether it could want a node whose variation is not known.
    bool may_want(const ClusterNode& node) const noexcept {
        return wants(node, std::numeric_limits<double>::infinity());
    }
};

/// What splitting a cluster is worth, of its moments and how it spreads.
using SplitPriority = double (*)(const SampleMoments&, const Spread&) noexcept;

/// A cut through the tree: cluster i is the members `offsets[i] .. offsets[i + 1]`.
struct Cut {
    std::vector<Index> offsets;
    /// The nodes at and above the cut, each before those below it, left before right: of how many
    /// clusters it consists. The first half of a node of more than one is the next node, and the
    /// other half comes 2 n - 1 places after that one, n being its clusters.
    std::vector<Index> clusters_of;
};

/// The binary space partition of a cloud (§3.1), grown as far as asked. A node is split in the same
/// way whatever was asked for before.
///
/// 36 bytes a point up to `kResident` of them; of a larger cloud 4, and while it grows as many more
/// and 32 for each point that a thread works on. 32 bytes for each node.
class ClusterTree {
public:
    /// One root with all points: finite, no two alike, at least one. They must stay where they are.
    explicit ClusterTree(std::span<const Vec3f> points, SplitPriority priority = gain_of_split);
    /// A root for each cluster: none of the tree's reaches beyond one. Always the widest cluster is
    /// split, for the most even spacing.
    ClusterTree(std::span<const Vec3f> points, const Clusters& roots);
    ClusterTree(const ClusterTree&) = delete;
    ClusterTree& operator=(const ClusterTree&) = delete;

    /// Splits what the rule wants, and the halves of it, and so on. Once only, and not after `cut`.
    void grow(const SplitRule& rule, const RunContext& context);

    /// The clusters that a priority queue holds when there are `size` of them; grows the tree where
    /// it must. Number of roots <= size <= number of points.
    Cut cut(std::uint64_t size, const RunContext& context);
    /// The same of several sizes, none larger than the one before: all but the first take little.
    std::vector<Cut> cuts(std::span<const std::uint64_t> sizes, const RunContext& context);

    /// The leaves.
    Cut leaves(const RunContext& context) const;

    /// Gives back the memory of the nodes: of the tree, only the members can be asked for then.
    void forget_nodes() noexcept;

    /// The numbers of the points, cluster by cluster, left before right.
    std::span<const Index> members() const noexcept { return members_; }

private:
    using Nodes = std::pmr::vector<ClusterNode>;

    void plant(const RunContext& context);
    void split_large(const SplitRule& rule, const RunContext& context);
    void grow_leaves(const SplitRule& rule, const RunContext& context);
    std::vector<SplitRank> first_splits(std::size_t count, const RunContext& context);
    template <typename Descends>
    Cut cut_where(const Descends& descends, std::size_t clusters, const RunContext& context) const;

    std::span<const Vec3f> points_;
    std::pmr::monotonic_buffer_resource memory_;  ///< one piece, which takes the least time to get
    MutableSampleSpan room_{};  ///< for all points twice where they are few, else empty
    std::span<Index> members_;
    Nodes nodes_;  ///< the roots first; none while there is but one and it has not grown
    Index roots_ = 1;
    SplitPriority priority_;
};

}  // namespace stipple
