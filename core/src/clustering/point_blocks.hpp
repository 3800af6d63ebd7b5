#pragma once

#include "cloud/samples.hpp"
#include "clustering/cluster_kernels.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <limits>
#include <optional>
#include <span>
#include <vector>

namespace stipple {

/// Points in blocks of a few neighbours that lie together in memory, under a tree of boxes, eight
/// to a node: for queries in which a point may no longer take part.
///
/// The blocks are the leaves of a binary partition at the middle of the longest side, so that they
/// follow any density and an outlier costs nothing.
class PointBlocks {
public:
    static constexpr std::size_t kSlack = 8;

    /// Finite points, at least one, in blocks of at most `most_in_block`. Coordinates are
    /// multiplied by `scale`, or where there is none by a power of two such that no square of a
    /// difference over- or underflows. O(N log N), parallel; 36 bytes a point.
    PointBlocks(std::span<const Vec3f> points, std::size_t most_in_block,
                std::optional<float> scale, const RunContext& context);

    float scale() const noexcept { return scale_; }
    /// The longest side of the box of all, scaled.
    float extent() const noexcept { return extent_; }
    /// The points, block by block.
    SampleSpan samples() const noexcept { return storage_.all().part(0, size_); }

    /// Leaves the sample at `place` out of what `find` calls free.
    void take(Index place) noexcept { taken_[place] = std::numeric_limits<float>::infinity(); }
    void free_all(const RunContext& context);

    /// Whether the sample is free and nothing keeps it from being a seed.
    bool may_seed(Index place) const noexcept { return taken_[place] == 0; }
    /// Keeps the free samples of its block from it, of those at `begin..end`.
    void keep_block_from_seeding(Index place, Index begin, Index end) noexcept;
    void let_all_seed(const RunContext& context);

    /// The blocks about a place, for looks from there and from close by.
    struct Vicinity {
        Vec3f center = Vec3f::Zero();
        float radius = -1;             ///< within which of the center every block is in a group
        std::vector<Index> groups;     ///< of eight blocks, ascending
        std::size_t sample_count = 0;  ///< in all of them
    };
    /// Moves the vicinity where it lacks a block of which a part may be within `radius` (finite) of
    /// q.
    void approach(const Vec3f& q, float radius, Vicinity& vicinity) const;

    /// The blocks for `ClusterKernels::nearby`. Of each sample 0 is told, or less where it may be
    /// no seed, or infinity when it is taken.
    SampleBlocks view() const noexcept {
        return {samples(), taken_.data(), begins_.data(), levels_.front().data()};
    }

private:
    struct Leaves {
        std::vector<Index> begins;
        std::vector<SampleBox> boxes;
    };

    void choose_scale(const RunContext& context);
    void partition(std::size_t begin, std::size_t end, bool is_aside, Leaves& leaves,
                   const RunContext& context);
    void stack_levels(std::vector<SampleBox> boxes);

    void add_groups(std::size_t level, Index node, std::size_t at_most, Vicinity& vicinity) const;

    std::size_t size_, most_in_block_;
    float scale_, extent_;
    Samples storage_;            ///< the samples, and as many places again for their partition
    std::vector<float> taken_;   ///< 0 or -1, infinity; `kSlack` more than there are samples
    std::vector<Index> begins_;  ///< of each block; one more for the end
    std::vector<std::vector<EightBoxes>>
        levels_;  ///< the boxes of the blocks, of eight of them, ...
};

}  // namespace stipple
