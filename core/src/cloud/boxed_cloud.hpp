#pragma once

#include "stipple/point_cloud.hpp"

#include <string>

namespace stipple {

/// @param which  what the cloud is called in the message.
/// @throws Error(InvalidArgument) where there is no point, or one is not finite, or `validate`
/// does.
void check_positions(const PointCloud& cloud, const std::string& which);

/// A cloud that can be measured and its `bounds`.
struct BoxedCloud {
    const PointCloud& cloud;
    Aabb box;

    /// @throws as `check_positions`.
    BoxedCloud(const PointCloud& cloud, const std::string& which);
    Vec3d middle() const { return 0.5 * (box.min + box.max); }
};

}  // namespace stipple
