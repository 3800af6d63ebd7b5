#include "pyramid/surface_rounding.hpp"

#include "cloud/float4.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace stipple {

namespace {

constexpr std::size_t kLanes = 4, kAtOnce = 64;
using Floats = std::array<float, kAtOnce>;

/// Up to `kAtOnce` points, coordinate by coordinate.
struct Block {
    std::array<std::array<double, kAtOnce>, 3> nearest{};  ///< place, in steps
    std::array<Floats, 3> way{};                           ///< from the point to that
    std::array<Floats, 3> normal{};
    std::array<Floats, 3> aside{};  ///< from the nearest place to the best, in steps
    Floats least{};                 ///< what that costs

    /// Tries the best of the three places that are so many steps beside the nearest.
    void try_steps(float step_x, float step_y) noexcept {
        constexpr float kAlong = 0.02F;  // what a way along the surface counts
        const Float4 zero{}, one = zero + 1.0F;
        for (std::size_t i = 0; i < kAtOnce; i += kLanes) {
            const Float4 nz = load(&normal[2][i]), way_z = load(&way[2][i]);
            const Float4 x = load(&way[0][i]) + step_x, y = load(&way[1][i]) + step_y;
            const Float4 across = load(&normal[0][i]) * x + load(&normal[1][i]) * y;
            // Along the third axis the cost is a parabola: the step nearest to its bottom.
            const Float4 bottom = -across * nz / (nz * nz + kAlong) - way_z;
            const Float4 step_z = (bottom > 0.5F ? one : zero) - (bottom < -0.5F ? one : zero);
            const Float4 z = way_z + step_z, height = across + nz * z;
            const Float4 cost = height * height + kAlong * (x * x + y * y + z * z);
            const Float4 before = load(&least[i]);
            const auto less = cost < before;
            const std::array<Float4, 3> steps = {zero + step_x, zero + step_y, step_z};
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const Float4 kept = load(&aside[axis][i]);
                store(&aside[axis][i], less ? steps[axis] : kept);
            }
            store(&least[i], less ? cost : before);
        }
    }
};

}  // namespace

void round_to_surface(std::span<const Vec3f> points, std::span<const NormalAndBend> normals,
                      double step, Vec3f* to) noexcept {
    constexpr double kOutwards = 2.5;  // of the curvature, which is told by half
    constexpr double kFarthest = 0.5;  // in steps
    Block block;
    for (std::size_t begin = 0; begin < points.size(); begin += kAtOnce) {
        const std::size_t count = std::min(kAtOnce, points.size() - begin);
        for (std::size_t i = 0; i < count; ++i) {
            const auto& [normal, bend] = normals[begin + i];
            const double inwards =
                std::clamp(kOutwards * static_cast<double>(bend) * step, -kFarthest, kFarthest);
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const auto a = static_cast<Eigen::Index>(axis);
                const double at = static_cast<double>(points[begin + i][a]) / step -
                                  inwards * static_cast<double>(normal[a]);
                block.nearest[axis][i] = std::floor(at + 0.5);
                block.way[axis][i] = static_cast<float>(block.nearest[axis][i] - at);
                block.normal[axis][i] = normal[a];
            }
        }
        block.least.fill(std::numeric_limits<float>::infinity());
        for (int place = 0; place < 9; ++place)
            block.try_steps(static_cast<float>(place % 3 - 1), static_cast<float>(place / 3 - 1));
        for (std::size_t i = 0; i < count; ++i) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const double aside = static_cast<double>(block.aside[axis][i]);
                to[begin + i][static_cast<Eigen::Index>(axis)] =
                    static_cast<float>(step * (block.nearest[axis][i] + aside));
            }
        }
    }
}

}  // namespace stipple
