#include "particles/surface_samples.hpp"

#include "analysis/lone_points.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/symmetric_eigen.hpp"
#include "cloud/box_of_most.hpp"
#include "neighbors/nearest_lists.hpp"
#include "neighbors/point_tree.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 1'024;

// No place inside of evenly spread samples is further than about 0.3 radii from all of them. The
// mean of the neighbours of a sample on a straight border is 4 / (3 pi) = 0.42 radii away.
constexpr float kInside = 0.4F;
constexpr float kTwoSided = 0.2F, kOneSided = 0.35F;

void analyze(SurfaceSamples& s, std::size_t i, float radius) {
    const std::span<const Index> near = s.neighbors_of(i);
    TangentPlane& plane = s.planes[i];
    const Vec3f p = s.positions[i];
    Vec3f sum = Vec3f::Zero(), squares = Vec3f::Zero(), products = Vec3f::Zero();
    for (const Index j : near) {
        const Vec3f d = s.positions[j] - p;
        sum += d;
        squares += d.cwiseProduct(d);
        products += Vec3f(d.x() * d.y(), d.y() * d.z(), d.z() * d.x());
    }
    // Around the centroid of the neighbours and the point itself, Eq. 1.
    const Vec3d total = sum.cast<double>(), q = squares.cast<double>(), m = products.cast<double>();
    const double by = 1.0 / static_cast<double>(near.size() + 1);
    const Symmetric3 scatter = {
        q.x() - by * total.x() * total.x(), m.x() - by * total.x() * total.y(),
        m.z() - by * total.z() * total.x(), q.y() - by * total.y() * total.y(),
        m.y() - by * total.y() * total.z(), q.z() - by * total.z() * total.z()};
    const std::array<double, 3> lambda = eigenvalues(scatter);
    plane.normal = eigenvector(scatter, lambda[0]).cast<float>();
    s.variation[i] =
        scatter.trace() > 0 ? static_cast<float>(std::max(0.0, lambda[0]) / scatter.trace()) : 0.0F;
    plane.radius = radius;
    // Along the plane: across an edge of a closed surface it goes on.
    Vec3f mean = sum / static_cast<float>(std::max<std::size_t>(1, near.size()));
    mean -= plane.normal * plane.normal.dot(mean);
    const float offset = mean.norm();
    plane.outward = offset > 0 ? Vec3f(-mean / offset) : Vec3f::Zero();
    const float sided = radius > 0 ? offset / radius : 0.0F;
    plane.outer =
        kInside * radius * std::clamp((kOneSided - sided) / (kOneSided - kTwoSided), 0.0F, 1.0F);
}

/// A sample that lies alone, as stray returns of a scanner do, stands for little more than most do
/// and for no surface around it: else some twenty would have more particles than all others.
void confine(SurfaceSamples& s, std::size_t i, const LonePoints& lone_points) {
    constexpr std::size_t kAround = 8;
    constexpr float kMost = 4;  // times what most stand for: among trees many lie alone
    const std::span<const Index> near = s.neighbors_of(i);
    const Vec3f& p = s.positions[i];
    double sum = 0;
    for (const Index j : near.first(std::min(near.size(), kAround)))
        sum += static_cast<double>((s.positions[j] - p).squaredNorm());
    const auto mean_sq = static_cast<float>(sum / (kAround + 1));
    const auto [area, doubtful_sq] = lone_points.area_of(p, mean_sq);
    const float most = doubtful_sq == 0 ? kMost * area : area;
    if (!(most < mean_sq)) return;
    TangentPlane& plane = s.planes[i];
    plane.radius *= std::sqrt(most / mean_sq);
    plane.outer = std::min(plane.outer, kInside * plane.radius);
}

}  // namespace

ParticleFrame::ParticleFrame(std::span<const Vec3f> points) {
    low = high = points.front();
    for (const Vec3f& p : points) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
    center = 0.5 * (low.cast<double>() + high.cast<double>());
    double extent = (high.cast<double>() - low.cast<double>()).maxCoeff();
    // Where a few points lie far off, floats are to be at their best about most, as in
    // `ErrorFrame`.
    constexpr double kFarOff = 64, kFarthest = 0x1p40;  // in the frame, where it has a square
    const Aabb most = box_of_most(
        some_of(points.size(), [&](std::size_t i) { return Vec3d(points[i].cast<double>()); }));
    if (const double side = longest_side(most); side > 0 && extent > kFarOff * side) {
        center = 0.5 * (most.min + most.max);
        extent = std::max(side, extent / kFarthest);
    }
    scale = extent > 0 ? std::ldexp(1.0, std::ilogb(extent)) : 0;
    low = inside(low.cast<double>());
    high = inside(high.cast<double>());
}

float TangentPlane::area() const noexcept {
    constexpr float kSmallest = 1e-30F;  // where samples coincide
    return std::max(kSmallest, std::numbers::pi_v<float> / kSampleNeighbors * radius * radius);
}

float TangentPlane::border() const noexcept {
    return kInside * radius;
}

SurfaceSamples sample_surface(const PointCloud& cloud, std::vector<Index> points,
                              const ParticleFrame& frame, const RunContext& context) {
    const std::size_t n = points.size();
    SurfaceSamples s;
    s.points = std::move(points);
    resize_in_blocks(s.positions, n, context);
    resize_in_blocks(s.planes, n, context);
    resize_in_blocks(s.variation, n, context);
    parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            s.positions[i] = frame.inside(cloud.positions[s.points[i]].cast<double>());
    });
    NearestLists found = nearest_lists(s.positions, kSampleNeighbors, context);
    s.neighbors = std::move(found.indices);
    s.neighbor_count = found.each;  // no more than there are others
    const PointTree tree(s.positions, PointTree::Leaves::Given, context);
    const LonePoints lone_points(s.positions, tree);
    parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const std::span<const Index> near = s.neighbors_of(i);
            analyze(s, i, near.empty() ? 0.0F : (s.positions[near.back()] - s.positions[i]).norm());
            confine(s, i, lone_points);
        }
    });
    return s;
}

}  // namespace stipple
