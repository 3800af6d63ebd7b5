#include "analysis/lone_points.hpp"

#include "cloud/box_of_most.hpp"
#include "neighbors/tree_search.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace stipple {

namespace {

constexpr std::size_t kThird = 3, kAround = 8;

using Nearest = std::array<Neighbor, kAround + 1>;  // the point itself and others

float mean_of_squares(std::span<const Neighbor> nearest) noexcept {
    double sum = 0;
    for (const Neighbor& neighbor : nearest) sum += neighbor.distance_sq;
    return static_cast<float>(sum / static_cast<double>(nearest.size()));
}

/// Whether points are spread about as far in all directions.
bool are_on_no_surface(std::span<const Neighbor> nearest, std::span<const Vec3f> points) {
    constexpr double kRound = 0.03;  // λ0 / λ1
    Vec3d mean = Vec3d::Zero();
    for (const Neighbor& neighbor : nearest) mean += points[neighbor.index].cast<double>();
    mean /= static_cast<double>(nearest.size());
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (const Neighbor& neighbor : nearest) {
        const Vec3d way = points[neighbor.index].cast<double>() - mean;
        covariance += way * way.transpose();
    }
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    const Vec3d values = solver.computeDirect(covariance, Eigen::EigenvaluesOnly).eigenvalues();
    return values[0] > kRound * values[1];
}

/// Half the square about most of the tree's points.
float square_about_most(const PointTree& tree) {
    const double side = longest_side(box_of_most(some_of(
        tree.size(), [&](std::size_t i) { return Vec3d(tree.position(i).cast<double>()); })));
    return side > 0 ? static_cast<float>(0.5 * side * side)
                    : std::numeric_limits<float>::infinity();
}

/// The value that so large a part of some are not above.
float quantile(std::vector<float>& values, double part) {
    const auto at =
        values.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
    std::ranges::nth_element(values, at);
    return *at;
}

}  // namespace

bool lies_alone(std::span<const Neighbor> nearest, std::span<const Vec3f> points) noexcept {
    constexpr float kMuchNearer = 4;
    if (nearest.size() <= kThird) return false;
    const Neighbor& third = nearest[kThird];
    const auto is_beside = [&](const Neighbor& other) {
        const float distance_sq = (points[other.index] - points[third.index]).squaredNorm();
        return kMuchNearer * kMuchNearer * distance_sq < third.distance_sq;
    };
    return std::ranges::count_if(nearest, is_beside) > std::ptrdiff_t{kThird};  // it is one of them
}

LonePoints::LonePoints(std::span<const Vec3f> points, const PointTree& tree)
    : points_(points), tree_(tree), largest_(square_about_most(tree)) {
    constexpr std::size_t kAsked = 256;
    constexpr double kFar = 8;                       // gaps
    constexpr double kMost = 0.95;                   // of the points have an area up to some value
    constexpr float kMuchWider = 8, kFarWider = 64;  // times that, and times that again
    std::vector<float> gaps, areas;
    Nearest room;
    for (std::size_t i = 0; i < tree.size(); i += std::max<std::size_t>(1, tree.size() / kAsked)) {
        const std::span<const Neighbor> nearest = find_nearest(tree, tree.position(i), room);
        gaps.push_back(
            std::sqrt(nearest[std::min<std::size_t>(1, nearest.size() - 1)].distance_sq));
        areas.push_back(mean_of_squares(nearest));
    }
    usual_ = static_cast<float>(kFar * static_cast<double>(quantile(gaps, 0.5)));
    usual_area_ = quantile(areas, 0.5);
    wide_ = std::min(largest_, kMuchWider * quantile(areas, kMost));
    largest_ = std::min(largest_, kFarWider * wide_);
}

LonePoints::LonePoints(std::span<const Vec3f> part, const PointTree& tree, const LonePoints& some,
                       double every)
    : points_(part),
      tree_(tree),
      usual_(static_cast<float>(some.usual_ / std::sqrt(every))),
      usual_area_(static_cast<float>(some.usual_area_ / every)),
      wide_(static_cast<float>(some.wide_ / every)),
      largest_(static_cast<float>(some.largest_ / every)) {}

bool LonePoints::holds(const Vec3f& place, float reach) const {
    if (reach <= usual_) return false;
    Nearest room;
    return holds(find_nearest(tree_, place, room));
}

bool LonePoints::holds(std::span<const Neighbor> nearest) const {
    return lies_alone(nearest, points_) ||
           (mean_of_squares(nearest) > wide_ && are_on_no_surface(nearest, points_));
}

LonePoints::Area LonePoints::area_of(const Vec3f& point, float mean_sq) const {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    if (mean_sq <= wide_) return {mean_sq, kInfinity};
    if (holds(point, kInfinity)) return {usual_area_, 0};
    return {std::min(mean_sq, largest_), usual_area_};
}

LonePoints::Area LonePoints::area_of(const Vec3f& point) const {
    Nearest room;
    return area_of(point, mean_of_squares(find_nearest(tree_, point, room)));
}

}  // namespace stipple
