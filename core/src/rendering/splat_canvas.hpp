#pragma once

#include "stipple/point_cloud.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <limits>
#include <memory>

namespace stipple {

/// The samples of a picture and the rays through them.
struct Raster {
    int width, height;  ///< samples
    double scale;       ///< samples to the unit of the picture plane
    bool perspective;

    /// From one row of samples to the next: four can be read from any of a row.
    std::size_t stride() const { return static_cast<std::size_t>(width) + 3; }
    std::size_t index(int x, int y) const {
        return static_cast<std::size_t>(y) * stride() + static_cast<std::size_t>(x);
    }

    /// Where the ray through the middle of a sample meets the picture plane.
    Eigen::Vector2d ray(int x, int y) const {
        return {(x + 0.5 - 0.5 * width) / scale, (0.5 * height - y - 0.5) / scale};
    }
    /// Where a point in the camera's axes is seen, in samples.
    Eigen::Vector2d project(const Vec3d& p) const {
        const double s = perspective ? scale / p.z() : scale;
        return {p.x() * s + 0.5 * width - 0.5, 0.5 * height - p.y() * s - 0.5};
    }
};

/// What is known of each sample of the picture, row by row. Nothing is set before it is cleared: a
/// thread clears the rows that it draws.
struct Canvas {
    static constexpr float kFar = std::numeric_limits<float>::infinity();

    explicit Canvas(const Raster& raster)
        : size(raster.stride() * static_cast<std::size_t>(raster.height)),
          depth(std::make_unique_for_overwrite<float[]>(size)),
          normal(std::make_unique_for_overwrite<Vec3f[]>(size)),
          albedo(std::make_unique_for_overwrite<Eigen::Vector4f[]>(size)) {}

    /// The samples of these indices show nothing.
    void clear(std::size_t begin, std::size_t end) {
        std::fill(&depth[begin], &depth[end], kFar);
        std::fill(&normal[begin], &normal[end], Vec3f(Vec3f::Zero()));
        std::fill(&albedo[begin], &albedo[end], Eigen::Vector4f(Eigen::Vector4f::Zero()));
    }

    std::size_t size;
    std::unique_ptr<float[]> depth;             ///< kFar where nothing is
    std::unique_ptr<Vec3f[]> normal;            ///< in the camera's axes; of any length and sign
    std::unique_ptr<Eigen::Vector4f[]> albedo;  ///< linear, times the weight; the weight
};

}  // namespace stipple
