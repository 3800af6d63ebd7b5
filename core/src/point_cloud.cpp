#include "stipple/point_cloud.hpp"

#include "cloud_copy.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <utility>

namespace stipple {

Reduction default_reduction(const AttributeValues& values) noexcept {
    const bool floating = std::holds_alternative<std::vector<float>>(values) ||
                          std::holds_alternative<std::vector<double>>(values);
    return floating ? Reduction::Mean : Reduction::Nearest;
}

void validate(const PointCloud& cloud) {
    const std::size_t n = cloud.size();
    const auto check = [n](const std::string& what, std::size_t entries, std::size_t components) {
        if (entries != n * components) {
            throw Error(ErrorCode::InvalidArgument, what + ": " + std::to_string(entries) +
                                                        " values for " + std::to_string(n) +
                                                        " points of " + std::to_string(components));
        }
    };
    if (n > std::numeric_limits<Index>::max()) {
        throw Error(ErrorCode::TooLarge, std::to_string(n) + " points: expected fewer than 2^32");
    }
    if (!cloud.normals.empty()) check("normals", cloud.normals.size(), 1);
    if (!cloud.colors.empty()) check("colors", cloud.colors.size(), 1);
    for (const Attribute& attribute : cloud.attributes) {
        check("attribute " + attribute.name, attribute.value_count(), attribute.components);
    }
}

Aabb bounds(const PointCloud& cloud) {
    Vec3f low = Vec3f::Constant(std::numeric_limits<float>::infinity());
    Vec3f high = -low;
    for (const Vec3f& p : cloud.positions) {
        if (!p.allFinite()) continue;
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
    if (!(low.array() <= high.array()).all()) return {};
    return {low.cast<double>() + cloud.origin, high.cast<double>() + cloud.origin};
}

PointCloud subset(const PointCloud& cloud, std::span<const Index> indices) {
    return subset(cloud, indices, {});
}

const Attribute* find_attribute(const PointCloud& cloud, std::string_view name) noexcept {
    const auto found = std::ranges::find(cloud.attributes, name, &Attribute::name);
    return found == cloud.attributes.end() ? nullptr : &*found;
}

void set_attribute(PointCloud& cloud, Attribute attribute) {
    const auto found = std::ranges::find(cloud.attributes, attribute.name, &Attribute::name);
    if (found == cloud.attributes.end()) {
        cloud.attributes.push_back(std::move(attribute));
    } else {
        *found = std::move(attribute);
    }
}

}  // namespace stipple
