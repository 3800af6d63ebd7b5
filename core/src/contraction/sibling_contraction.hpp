#pragma once

#include "contraction/sample_quadrics.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

/// Contraction of samples along a binary tree whose leaves they are: of two halves of a node, each
/// one point already, the pair that costs least becomes one point, which then is its node. What it
/// costs is the error of the node's quadric where that is least, times the distance of the two; or
/// as much as the dearest contraction below it, if that is more.
///
/// No point stands for more than twice as many samples as all do on average, as far as the tree
/// lets it be: flat parts would keep far fewer points than what is beside or behind them, and the
/// surface through the points nearest to a place there would not be that of the place.
class SiblingContraction {
public:
    /// @param samples_of  of each node, in the order of `Cut::clusters_of`; both stay alive.
    /// O(M), parallel; 8 bytes a node.
    SiblingContraction(const QuadricSamples& samples, std::span<const Index> samples_of,
                       const RunContext& context);

    /// The first sample of each of the `size` points that are left when the contractions to points
    /// of too many samples are made last, and else the cheapest first; and the end of the last. 1
    /// <= size <= number of samples.
    std::vector<Index> nodes_left(std::size_t size, const RunContext& context) const;

    /// The point that the samples `begin .. end` become: where their quadrics together are least,
    /// but no farther out than they are.
    Vec3f place_of(Index begin, Index end) const;

    /// What making a node one point costs; 0 for a leaf.
    std::span<const double> costs() const noexcept { return costs_; }

private:
    struct Joined;
    Joined join(std::size_t node, Index first, const RunContext& context);

    const QuadricSamples& samples_;
    std::span<const Index> samples_of_;
    std::vector<double> costs_;
};

}  // namespace stipple
