// PCL: filters on PointXYZ, normals with the k-d tree it takes by itself.

#include "peer_tools.hpp"

#include <pcl/features/normal_3d_omp.h>
#include <pcl/filters/farthest_point_sampling.h>
#include <pcl/filters/uniform_sampling.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <cmath>
#include <memory>

namespace stipple::bench::pcl_peer {

namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using Simplify = void (*)(const Cloud::Ptr& cloud, double parameter, Cloud& result);

Cloud::Ptr from_stipple(const PointCloud& cloud) {
    auto points = std::make_shared<Cloud>();
    points->reserve(cloud.size());
    for (const Vec3f& p : cloud.positions) points->emplace_back(p.x(), p.y(), p.z());
    return points;
}

PointCloud to_stipple(const Cloud& points) {
    PointCloud cloud;
    for (const pcl::PointXYZ& p : points) cloud.positions.emplace_back(p.x, p.y, p.z);
    return cloud;
}

void voxel(const Cloud::Ptr& cloud, double leaf, Cloud& result) {
    pcl::VoxelGrid<pcl::PointXYZ> filter;
    filter.setInputCloud(cloud);
    const auto size = static_cast<float>(leaf);
    filter.setLeafSize(size, size, size);
    filter.filter(result);
}

void uniform(const Cloud::Ptr& cloud, double radius, Cloud& result) {
    pcl::UniformSampling<pcl::PointXYZ> filter;
    filter.setInputCloud(cloud);
    filter.setRadiusSearch(radius);
    filter.filter(result);
}

void farthest(const Cloud::Ptr& cloud, double count, Cloud& result) {
    pcl::FarthestPointSampling<pcl::PointXYZ> filter;
    filter.setInputCloud(cloud);
    filter.setSample(static_cast<std::size_t>(count));
    filter.setSeed(1);
    filter.filter(result);
}

Peer simplifier(std::string name, const Model& model, Simplify simplify,
                std::shared_ptr<double> parameter, std::function<void(const Cloud::Ptr&)> tune) {
    return {.name = std::move(name),
            .load = [&model, tune = std::move(tune)]() -> std::any {
                auto cloud = from_stipple(model.cloud);
                tune(cloud);
                return cloud;
            },
            .run = [=](std::any& cloud, unsigned) -> std::any {
                const auto result = std::make_shared<Cloud>();
                simplify(std::any_cast<Cloud::Ptr&>(cloud), *parameter, *result);
                return result;
            },
            .points =
                [](const std::any&, const std::any& result) {
                    return to_stipple(*std::any_cast<const Cloud::Ptr&>(result));
                }};
}

Peer tuned_simplifier(std::string name, const Model& model, std::size_t target, Simplify simplify) {
    const double guess = bounds(model.cloud).diagonal() / std::sqrt(static_cast<double>(target));
    const auto parameter = std::make_shared<double>(0);
    return simplifier(std::move(name), model, simplify, parameter, [=](const Cloud::Ptr& cloud) {
        if (*parameter != 0) return;
        *parameter = tuned(
            [&](double value) {
                Cloud result;
                simplify(cloud, value, result);
                return result.size();
            },
            target, guess);
    });
}

}  // namespace

std::vector<Peer> simplifiers(const Model& model, std::size_t target) {
    return {tuned_simplifier("PCL VoxelGrid", model, target, voxel),
            tuned_simplifier("PCL UniformSampling", model, target, uniform),
            simplifier("PCL FarthestPointSampling", model, farthest,
                       std::make_shared<double>(static_cast<double>(target)),
                       [](const Cloud::Ptr&) {})};
}

std::vector<Peer> analyzers(const Model& model, unsigned k) {
    return {{.name = "PCL NormalEstimationOMP",
             .load = [&model]() -> std::any { return from_stipple(model.cloud); },
             .run = [k](std::any& cloud, unsigned threads) -> std::any {
                 pcl::NormalEstimationOMP<pcl::PointXYZ, pcl::Normal> estimation(threads);
                 estimation.setInputCloud(std::any_cast<Cloud::Ptr&>(cloud));
                 estimation.setSearchMethod(std::make_shared<pcl::search::KdTree<pcl::PointXYZ>>());
                 estimation.setKSearch(static_cast<int>(k));
                 const auto normals = std::make_shared<pcl::PointCloud<pcl::Normal>>();
                 estimation.compute(*normals);
                 return normals;
             }}};
}

}  // namespace stipple::bench::pcl_peer
