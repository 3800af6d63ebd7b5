#include "support/oracles.hpp"

#include "support/eigen_system.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <numeric>
#include <tuple>

namespace stipple::test {

std::vector<std::pair<float, Index>> sorted_distances(const std::vector<Vec3f>& points,
                                                      std::size_t i) {
    std::vector<std::pair<float, Index>> result;
    for (std::size_t j = 0; j < points.size(); ++j) {
        if (j == i) continue;
        const Vec3f d = points[j] - points[i];
        result.emplace_back(d.x() * d.x() + d.y() * d.y() + d.z() * d.z(), static_cast<Index>(j));
    }
    std::ranges::sort(result);
    return result;
}

namespace {

void split(const std::vector<Vec3f>& points, const std::vector<Index>& members,
           std::size_t max_size, double max_variation, std::set<std::set<Index>>& clusters) {
    Vec3d centroid = Vec3d::Zero();
    for (const Index i : members) centroid += points[i].cast<double>();
    centroid /= static_cast<double>(members.size());
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (const Index i : members) {
        const Vec3d d = points[i].cast<double>() - centroid;
        covariance += d * d.transpose();
    }
    const auto [lambda, vectors] = eigen_system(covariance);
    const double variation = covariance.trace() > 0 ? lambda[0] / covariance.trace() : 0.0;
    if (members.size() < 2 || (members.size() <= max_size && variation <= max_variation)) {
        clusters.emplace(members.begin(), members.end());
        return;
    }
    const Vec3d axis = vectors.col(2);
    std::vector<Index> left, right;
    for (const Index i : members) {
        ((points[i].cast<double>() - centroid).dot(axis) < 0 ? left : right).push_back(i);
    }
    split(points, left, max_size, max_variation, clusters);
    split(points, right, max_size, max_variation, clusters);
}

}  // namespace

std::set<std::set<Index>> recursive_clusters(const std::vector<Vec3f>& points, std::size_t max_size,
                                             double max_variation) {
    std::vector<Index> all(points.size());
    std::iota(all.begin(), all.end(), Index{0});
    std::set<std::set<Index>> clusters;
    split(points, all, max_size, max_variation, clusters);
    return clusters;
}

namespace {

struct Contractible {
    Vec3d position;  // in units of the scale
    Quadric quadric;
    std::set<Index> neighbors;
    bool live = true;
    std::vector<Index> samples;
};

/// The quadric of both relative to the first, where it is least, and the cost of the pair.
std::tuple<Quadric, Vec3d, double> joined(const Contractible& a, const Contractible& b) {
    const Vec3d d = b.position - a.position;
    const Quadric sum = a.quadric + referred_to(b.quadric, -d);
    Eigen::Matrix3d matrix;
    matrix << sum.xx, sum.xy, sum.xz, sum.xy, sum.yy, sum.yz, sum.xz, sum.yz, sum.zz;
    const Vec3d y = matrix.fullPivLu().solve(-Vec3d(sum.x, sum.y, sum.z));
    const double added = value(sum, y) - a.quadric.c - b.quadric.c;
    return {sum, y, std::max(0.0, added) * d.norm()};
}

}  // namespace

ContractionSnapshot contract_by_queue(const std::vector<Vec3f>& points,
                                      const std::vector<StoredQuadric>& quadrics, double scale,
                                      std::size_t count, std::size_t k) {
    std::vector<Contractible> all(points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
        all[i].position = scale * points[i].cast<double>();
        all[i].quadric = Quadric(quadrics[i]);
        all[i].samples = {static_cast<Index>(i)};
        const auto nearest = sorted_distances(points, i);
        for (std::size_t j = 0; j < k; ++j) all[i].neighbors.insert(nearest[j].second);
    }
    std::set<std::tuple<double, Index, Index>> queue;
    const auto enqueue = [&](Index i, Index j) {
        queue.emplace(std::get<double>(joined(all[i], all[j])), i, j);
    };
    for (Index i = 0; i < all.size(); ++i)
        for (const Index j : all[i].neighbors) enqueue(i, j);
    for (std::size_t left = points.size(); left > count; --left) {
        const auto [cost, kept, gone] = *queue.begin();
        std::erase_if(queue, [kept = kept, gone = gone](const auto& entry) {
            const auto& [c, i, j] = entry;
            return i == kept || i == gone || j == kept || j == gone;
        });
        Contractible &a = all[kept], &b = all[gone];
        const auto [sum, y, unused] = joined(a, b);
        a.quadric = referred_to(sum, y);
        a.position += y;
        b.live = false;
        a.samples.insert(a.samples.end(), b.samples.begin(), b.samples.end());
        a.neighbors.insert(b.neighbors.begin(), b.neighbors.end());
        a.neighbors.erase(kept);
        a.neighbors.erase(gone);
        std::vector<std::pair<double, Index>> by_distance;
        for (const Index j : a.neighbors)
            by_distance.emplace_back((all[j].position - a.position).norm(), j);
        std::ranges::sort(by_distance);
        by_distance.resize(std::min(by_distance.size(), k));
        a.neighbors.clear();
        for (const auto& [distance, j] : by_distance) a.neighbors.insert(j);
        for (const Index j : a.neighbors) enqueue(kept, j);
        for (Index i = 0; i < all.size(); ++i) {
            if (!all[i].live || i == kept) continue;
            if (all[i].neighbors.erase(gone) > 0) all[i].neighbors.insert(kept);
            if (all[i].neighbors.contains(kept)) enqueue(i, kept);
        }
    }
    ContractionSnapshot snapshot;
    snapshot.survivor_of.resize(points.size());
    for (const Contractible& c : all) {
        if (!c.live) continue;
        for (const Index i : c.samples)
            snapshot.survivor_of[i] = static_cast<Index>(snapshot.positions.size());
        snapshot.positions.push_back((c.position / scale).cast<float>());
    }
    return snapshot;
}

}  // namespace stipple::test
