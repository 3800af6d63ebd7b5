#pragma once

#include "cloud/samples.hpp"
#include "clustering/representatives.hpp"
#include "stipple/lod_pyramid.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <memory>
#include <span>
#include <vector>

namespace stipple {

/// What levels are made of, along a curve: the points of a cloud, or those of a level, each of
/// which stands for some of the cloud's.
class LevelBase {
public:
    /// The cloud must stay where it is.
    /// @param order  of its points along a curve; empty: as they stand.
    LevelBase(const PointCloud& cloud, std::span<const Index> order, const RunContext& context);

    LevelBase(LevelBase&&) = default;
    LevelBase& operator=(LevelBase&&) = default;

    std::span<const Vec3f> points() const noexcept { return points_; }

private:
    friend class BaseClusters;
    struct Part {
        Index begin, end;
    };

    LevelBase() = default;

    std::span<const Part> parts_of(Index point) const noexcept {
        return {&parts_[firsts_[point]], firsts_[point + 1] - firsts_[point]};
    }

    std::vector<Vec3f> sorted_;  ///< none where the cloud's points stand as they are
    std::span<const Vec3f> points_;
    std::span<const Index> order_;            ///< of the cloud's
    std::shared_ptr<const Samples> samples_;  ///< of the cloud; none: the points are those
    std::vector<Part> parts_;                 ///< of the samples, point by point
    std::vector<Index> firsts_;               ///< of each point's, one more for the end
};

/// What clusters of a base's points have of the cloud.
class BaseClusters {
public:
    /// Base and members, of all clusters one behind the other, must stay where they are.
    BaseClusters(const LevelBase& base, std::span<const Index> members, const RunContext& context);

    /// The level of their representatives, with its order along the base's curve.
    /// @param offsets  of clusters in the members.
    LodLevel level(const PointCloud& cloud, std::span<const Index> offsets, Representative kind,
                   const Reductions& reductions, const RunContext& context) const;
    /// The points of such a level.
    LevelBase base_of(const LodLevel& level, std::span<const Index> offsets,
                      const RunContext& context) const;

private:
    std::vector<Index> in_samples(std::span<const Index> offsets) const;

    void gather_cloud(const RunContext& context);
    void gather_parts(const RunContext& context);

    const LevelBase& base_;
    std::span<const Index> members_;
    std::shared_ptr<Samples> samples_;  ///< of the cloud, in the order of the members
    std::vector<Index> begins_;  ///< of each member's, one more for the end; none: it is one sample
};

}  // namespace stipple
