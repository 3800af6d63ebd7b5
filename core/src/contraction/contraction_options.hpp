#pragma once

#include "stipple/iterative_simplification.hpp"
#include "stipple/multiphase.hpp"
#include "stipple/neighbors.hpp"

#include <span>
#include <vector>

namespace stipple {

/// The ranges of the options, but for the target, that hold whatever the cloud.
/// @throws Error(InvalidArgument).
void check_ranges(const IterativeSimplificationOptions& options);
void check_ranges(const MultiphaseOptions& options);

/// @throws Error(InvalidArgument) for a cloud without points, and options but for the target that
/// are out of range or name what the cloud has not.
void check_contraction(const PointCloud& cloud, const IterativeSimplificationOptions& options);

/// Values that the contraction keeps together, point by point; a difference of 1 counts as a
/// distance of 1.
struct Features {
    std::vector<float> values;
    unsigned channels = 0;

    /// As the weights of the options say; none where all are 0.
    Features(const PointCloud& cloud, const IterativeSimplificationOptions& options);
};

/// Moves points towards the tangent planes of the input points nearest to them until they are at
/// most `limit` away; towards such a point itself where its neighbours lie about no plane, or where
/// that comes to no end.
void bound_displacement(std::span<Vec3f> points, const std::vector<Vec3f>& input,
                        const NeighborSearch& search, double limit, const RunContext& context);

}  // namespace stipple
