#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace stipple {

/// Snapshots of one cloud, from few points to all, as a forest: a point of a snapshot is the child
/// of the point nearest to it in the snapshot before. A cut takes some places from one snapshot and
/// some from others, so that points are close where they must be.
class SnapshotForest {
public:
    /// @param levels  of the same attributes, the coarsest first; at least one, none empty, and
    /// fewer than 2^32 points in all of them. Memory: that of the levels, and 13 bytes for each of
    /// their points.
    SnapshotForest(std::vector<PointCloud> levels, const RunContext& context);

    std::size_t level_count() const noexcept { return offsets_.size() - 1; }
    std::size_t size_of(std::size_t level) const noexcept {
        return offsets_[level + 1] - offsets_[level];
    }
    PointCloud level(std::size_t level, const RunContext& context) const;

    /// Says that a level is too coarse around these places.
    void mark(std::size_t level, std::span<const Vec3f> places, const RunContext& context);
    /// Says that a cut is too coarse around these places: a step finer, or several.
    /// @return whether that changes anything.
    bool mark(std::span<const Index> cut, std::span<const Vec3f> places, unsigned steps,
              const RunContext& context);

    /// Says that everything but the finest level is too coarse around these places: also what
    /// stands for points there from farther away, such as from another sheet.
    /// @return whether that changes anything.
    bool mark_all(std::span<const Vec3f> places, const RunContext& context);

    /// What was said so far, to go back to: a byte for each point of all levels.
    std::vector<std::uint8_t> marks() const { return too_coarse_; }
    void set_marks(std::vector<std::uint8_t> marks) { too_coarse_ = std::move(marks); }

    /// Makes a cut finer around places that are much finer, so that a surface through neighbours of
    /// both has no seam. @return whether that changes anything.
    bool grade(std::span<const Index> cut, const RunContext& context);

    /// The points of the coarsest levels from `base` on that are not too coarse, tree by tree.
    std::vector<Index> cut(std::size_t base) const;
    /// What they are, no two at one place.
    PointCloud cloud_of(std::span<const Index> cut, const RunContext& context) const;

private:
    std::uint8_t level_of(Index node) const noexcept;
    std::span<const Index> children_of(Index node) const noexcept;
    void mark_below(Index node, unsigned steps);

    PointCloud nodes_;             ///< all levels, one after the other
    std::vector<Index> offsets_;   ///< of the levels
    std::vector<Index> parents_;   ///< of all nodes but those of the coarsest level
    std::vector<Index> children_;  ///< of all nodes but those of the finest level, flat
    std::vector<Index> first_child_;
    std::vector<std::uint8_t> too_coarse_;
};

}  // namespace stipple
