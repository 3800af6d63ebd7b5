#include "stipple/point_cloud.hpp"

#include "base/in_words.hpp"
#include "cloud/box_of_most.hpp"
#include "cloud/cloud_copy.hpp"
#include "cloud/float4.hpp"
#include "cloud/point_bounds.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <span>
#include <utility>

namespace stipple {

Reduction default_reduction(const AttributeValues& values) noexcept {
    const bool floating = std::holds_alternative<std::vector<float>>(values) ||
                          std::holds_alternative<std::vector<double>>(values);
    return floating ? Reduction::Mean : Reduction::Nearest;
}

void require_squares(double diagonal) {
    constexpr double kShortest = 1e-15, kLongest = 1e15;
    if (diagonal == 0 || (diagonal >= kShortest && diagonal <= kLongest)) return;
    const bool is_short = diagonal < kShortest;
    throw Error(ErrorCode::MalformedInput,
                in_words("the cloud is ", diagonal, " across: expected ", kShortest, " to ",
                         kLongest, ", or a single place; give it in a ",
                         is_short ? "smaller unit"
                                  : "larger unit, or without points that are far from all others"));
}

void validate(const PointCloud& cloud) {
    if (!cloud.origin.allFinite())
        throw Error(ErrorCode::InvalidArgument, "the origin is not finite");
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

namespace {

/// The box of points that are finite.
class Extent {
public:
    void add(const Vec3f& p) noexcept {
        if (!p.allFinite()) {
            all_finite_ = false;
            return;
        }
        low_ = low_.cwiseMin(p);
        high_ = high_.cwiseMax(p);
    }

    /// Four points, whose twelve coordinates lie one after the other.
    void add_four(const Vec3f* points) noexcept {
        const float* const values = points[0].data();
        const std::array<Float4, 3> four = {load(values), load(values + 4), load(values + 8)};
        const Float4 zeros = 0.0F * four[0] + 0.0F * four[1] + 0.0F * four[2];  // or not a number
        if (lane_bits(zeros == 0.0F) != 0xFU) {
            for (const Vec3f& p : std::span(points, 4)) add(p);
            return;
        }
        for (std::size_t i = 0; i < four.size(); ++i) {
            least_[i] = larger(-four[i], least_[i]);
            most_[i] = larger(four[i], most_[i]);
        }
    }

    /// Whether none was left out.
    bool all_finite() const noexcept { return all_finite_; }

    Aabb box(const Vec3d& origin) noexcept {
        for (std::size_t i = 0; i < 12; ++i) {
            const auto axis = static_cast<Eigen::Index>(i % 3);
            low_[axis] = std::min(low_[axis], -least_[i / 4][i % 4]);
            high_[axis] = std::max(high_[axis], most_[i / 4][i % 4]);
        }
        if (!(low_.array() <= high_.array()).all()) return {};
        return {low_.cast<double>() + origin, high_.cast<double>() + origin};
    }

private:
    static constexpr float kNone = -std::numeric_limits<float>::infinity();
    static constexpr Float4 kNothing = {kNone, kNone, kNone, kNone};

    bool all_finite_ = true;
    Vec3f low_ = Vec3f::Constant(-kNone), high_ = Vec3f::Constant(kNone);
    /// Of x y z x, y z x y and z x y z: the largest, and the largest of what is opposite.
    std::array<Float4, 3> most_ = {kNothing, kNothing, kNothing};
    std::array<Float4, 3> least_ = {kNothing, kNothing, kNothing};
};

Extent extent_of(std::span<const Vec3f> points) {
    Extent extent;
    std::size_t i = 0;
    for (; i + 4 <= points.size(); i += 4) extent.add_four(&points[i]);
    for (; i < points.size(); ++i) extent.add(points[i]);
    return extent;
}

}  // namespace

Aabb bounds(const PointCloud& cloud) {
    return extent_of(cloud.positions).box(cloud.origin);
}

Vec3d middle_of_most(const PointCloud& cloud) {
    const Aabb box = box_of_most(some_of(
        cloud.size(), [&](std::size_t i) { return Vec3d(cloud.positions[i].cast<double>()); }));
    return box.empty() ? Vec3d::Zero() : Vec3d(cloud.origin + 0.5 * (box.min + box.max));
}

std::optional<Aabb> finite_bounds(const PointCloud& cloud) {
    Extent extent = extent_of(cloud.positions);
    if (!extent.all_finite() || !cloud.origin.allFinite()) return std::nullopt;
    return extent.box(cloud.origin);
}

void require_cleaned(const PointCloud& cloud) {
    validate(cloud);
    if (!finite_bounds(cloud)) {
        throw Error(ErrorCode::InvalidArgument,
                    "positions: expected finite coordinates; remove the points that have others "
                    "(`clean`)");
    }
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
