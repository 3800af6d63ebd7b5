#include "support/oracles.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <numeric>

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
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
    const double variation =
        covariance.trace() > 0 ? solver.eigenvalues()[0] / covariance.trace() : 0.0;
    if (members.size() < 2 || (members.size() <= max_size && variation <= max_variation)) {
        clusters.emplace(members.begin(), members.end());
        return;
    }
    const Vec3d axis = solver.eigenvectors().col(2);
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

}  // namespace stipple::test
