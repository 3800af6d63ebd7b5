#pragma once

#include "base/first_touch.hpp"
#include "base/in_words.hpp"
#include "base/parallel_for.hpp"
#include "cloud/box_of_most.hpp"
#include "cloud/boxed_cloud.hpp"
#include "cloud/grid_step.hpp"
#include "stipple/error.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

namespace stipple {

/// Brings clouds to where floats are at their best, and back: the middle of the reference's box
/// lies at 0, and its diagonal is between 1 and 2. Where a few points lie far off, the middle is
/// that of the box about most: about 0 floats are at their best.
struct ErrorFrame {
    Vec3d center = Vec3d::Zero();
    double scale = 1;  ///< a power of two, so that nothing is lost on the way there and back

    ErrorFrame() = default;
    explicit ErrorFrame(const Aabb& reference) : center(0.5 * (reference.min + reference.max)) {
        const double diagonal = reference.diagonal();
        if (diagonal > 0) scale = std::ldexp(1.0, -std::ilogb(diagonal));
    }
    ErrorFrame(const Aabb& reference, const PointCloud& cloud) : ErrorFrame(reference) {
        constexpr double kFarOff = 64;  // as `choose_origin` has it
        const Aabb most = box_of_most(some_of(cloud.size(), [&](std::size_t i) -> Vec3d {
            return cloud.origin + cloud.positions[i].cast<double>();
        }));
        const double side = longest_side(most);
        if (side > 0 && longest_side(reference) > kFarOff * side)
            center = 0.5 * (most.min + most.max);
    }
    explicit ErrorFrame(const BoxedCloud& reference) : ErrorFrame(reference.box, reference.cloud) {}

    /// Squares of places of a cloud can be told in single precision.
    /// @throws Error(MalformedInput) where it reaches too far from the reference.
    void require_reach(const BoxedCloud& candidate) const {
        constexpr double kFarthest = 1e15;
        const Aabb& box = candidate.box;
        const double reach =
            (box.min - center).cwiseAbs().cwiseMax((box.max - center).cwiseAbs()).maxCoeff();
        if (reach * scale <= kFarthest) return;
        throw Error(
            ErrorCode::MalformedInput,
            in_words("the candidate reaches ", reach, " from the reference: at most ",
                     kFarthest / scale, " can be measured; are both in the same unit and place?"));
    }

    std::vector<Vec3f> into(const PointCloud& cloud, const RunContext& context) const {
        return into(
            cloud, cloud.size(), [](std::size_t i) { return i; }, context);
    }
    /// Some points of a cloud, in any order.
    std::vector<Vec3f> into(const PointCloud& cloud, std::span<const Index> points,
                            const RunContext& context) const {
        return into(
            cloud, points.size(), [&](std::size_t i) { return points[i]; }, context);
    }
    /// A position of a cloud, without its origin, as a place in the frame.
    Vec3f into(const Vec3f& position, const PointCloud& cloud) const {
        return (scale * (position.cast<double>() + (cloud.origin - center))).cast<float>();
    }
    /// The way back.
    Vec3f out_of(const Vec3f& place, const PointCloud& cloud) const {
        return (place.cast<double>() / scale + center - cloud.origin).cast<float>();
    }
    /// By how much the way there moves positions that lie in a box, along an axis, at most: a float
    /// is no farther from what it is shifted to than the shift is long.
    double rounding_of(const Aabb& box, const PointCloud& cloud) const {
        const Vec3d farthest =
            (box.min - center).cwiseAbs().cwiseMax((box.max - center).cwiseAbs());
        const Vec3d shift = (cloud.origin - center).cwiseAbs();
        return shift.cwiseMin(farthest.unaryExpr(&rounding_of_floats)).maxCoeff();
    }

private:
    template <typename NumberOf>
    std::vector<Vec3f> into(const PointCloud& cloud, std::size_t n, NumberOf&& number_of,
                            const RunContext& context) const {
        const Vec3d shift = cloud.origin - center;
        auto points = made_in_blocks<std::vector<Vec3f>>(n, context);
        constexpr std::size_t kBlock = 16'384;
        constexpr std::size_t kAhead = 16;  // that far the memory is asked for in advance
        parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                __builtin_prefetch(&cloud.positions[number_of(std::min(i + kAhead, end - 1))]);
                const Vec3d p = cloud.positions[number_of(i)].template cast<double>() + shift;
                points[i] = (scale * p).template cast<float>();
            }
        });
        return points;
    }
};

}  // namespace stipple
