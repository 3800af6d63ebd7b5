#include "error/attribute_error.hpp"

#include "base/distance_statistics.hpp"
#include "base/gaussian.hpp"
#include "base/parallel_for.hpp"
#include "cloud/color_difference.hpp"
#include "cloud/srgb.hpp"
#include "neighbors/tree_search.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <string>

namespace stipple {

namespace {

using Value = std::span<double>;

/// An attribute of two clouds as numbers, and what the difference of two values is.
struct Comparison {
    std::string name;
    unsigned components;
    bool averaged;
    std::function<void(const PointCloud&, Index, Value)> value;
    std::function<double(Value, Value)> difference;
};

Comparison colors() {
    const auto value = [](const PointCloud& cloud, Index i, Value v) {
        const std::array<float, 256>& linear = linear_from_srgb();
        const Rgba8 c = cloud.colors[i];
        v[0] = linear[c.r];
        v[1] = linear[c.g];
        v[2] = linear[c.b];
    };
    const auto difference = [](Value a, Value b) {
        return ciede2000(lab_from_linear({a[0], a[1], a[2]}), lab_from_linear({b[0], b[1], b[2]}));
    };
    return {"color", 3, true, value, difference};
}

Comparison normals() {
    const auto value = [](const PointCloud& cloud, Index i, Value v) {
        for (Eigen::Index axis = 0; axis < 3; ++axis)
            v[static_cast<std::size_t>(axis)] = cloud.normals[i][axis];
    };
    const auto difference = [](Value a, Value b) {
        const Vec3d m(a[0], a[1], a[2]), n(b[0], b[1], b[2]);
        if (m.isZero(0) || n.isZero(0)) return std::numeric_limits<double>::quiet_NaN();  // none
        return std::atan2(m.cross(n).norm(), m.dot(n));
    };
    return {"normal", 3, true, value, difference};
}

Comparison scalars(const Attribute& attribute) {
    const auto value = [name = attribute.name](const PointCloud& cloud, Index i, Value v) {
        std::visit(
            [&](const auto& values) {
                for (std::size_t c = 0; c < v.size(); ++c)
                    v[c] = static_cast<double>(values[i * v.size() + c]);
            },
            find_attribute(cloud, name)->values);
    };
    const auto difference = [](Value a, Value b) {
        double sum_sq = 0;
        for (std::size_t c = 0; c < a.size(); ++c) sum_sq += (a[c] - b[c]) * (a[c] - b[c]);
        return std::sqrt(sum_sq);
    };
    const bool averaged =
        attribute.reduction != Reduction::Nearest && attribute.reduction != Reduction::Mode;
    return {attribute.name, attribute.components, averaged, value, difference};
}

std::vector<Comparison> comparisons(const PointCloud& a, const PointCloud& b) {
    std::vector<Comparison> list;
    if (!a.colors.empty() && !b.colors.empty()) list.push_back(colors());
    if (!a.normals.empty() && !b.normals.empty()) list.push_back(normals());
    for (const Attribute& attribute : a.attributes) {
        const Attribute* const other = find_attribute(b, attribute.name);
        if (other != nullptr && other->components == attribute.components)
            list.push_back(scalars(attribute));
    }
    return list;
}

/// The fraction of the weight of values that are not 0.
double part_above_zero(std::span<const float> values, std::span<const float> weights) {
    double total = 0, above = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
        total += static_cast<double>(weights[i]);
        above += values[i] > 0 ? static_cast<double>(weights[i]) : 0.0;
    }
    return above / total;
}

/// The points that make up a value somewhere, and their weights, which add up to 1.
struct Blend {
    std::vector<Neighbor> room;
    std::span<Neighbor> points;
    std::vector<double> weights;

    void set(const AttributedSurface& surface, const Vec3f& place, unsigned k) {
        room.resize(k);
        weights.resize(k);
        points = find_nearest(surface.tree, place, room);
        const double r_sq = points.back().distance_sq;
        const double by = r_sq > 0 ? 9.0 / r_sq : 0.0;  // 1 / h^2
        double total = 0;
        for (std::size_t i = 0; i < points.size(); ++i)
            total += weights[i] = gaussian(points[i].distance_sq * by);
        for (double& w : weights) w /= total;
    }

    /// The mean of the finite numbers among the values, as scans have some that are none.
    /// @param one, missing  room, as large as v.
    void value(const PointCloud& cloud, const Comparison& attribute, Value v, Value one,
               Value missing) const {
        if (!attribute.averaged) return attribute.value(cloud, points.front().index, v);
        std::ranges::fill(v, 0.0);
        std::ranges::fill(missing, 0.0);  // the weights of what is none
        for (std::size_t i = 0; i < points.size(); ++i) {
            attribute.value(cloud, points[i].index, one);
            for (std::size_t c = 0; c < v.size(); ++c)
                (std::isfinite(one[c]) ? v : missing)[c] +=
                    weights[i] * (std::isfinite(one[c]) ? one[c] : 1.0);
        }
        constexpr double kAll = 1 - 1e-9;
        for (std::size_t c = 0; c < v.size(); ++c) {
            if (missing[c] == 0) continue;
            v[c] = missing[c] < kAll ? v[c] / (1 - missing[c])
                                     : std::numeric_limits<double>::quiet_NaN();
        }
    }
};

}  // namespace

std::vector<AttributeError> attribute_errors(const AttributedSurface& from,
                                             const AttributedSurface& to,
                                             std::span<const Vec3f> places,
                                             std::span<const Vec3f> feet,
                                             std::span<const float> areas, unsigned k,
                                             const RunContext& context) {
    const std::vector<Comparison> list = comparisons(from.cloud, to.cloud);
    if (list.empty()) return {};
    std::vector<std::vector<float>> differences(list.size(), std::vector<float>(places.size()));
    parallel_for_blocks(places.size(), 2048, context, [&](std::size_t begin, std::size_t end) {
        Blend here, there;
        std::array<std::vector<double>, 4> values;
        for (std::size_t i = begin; i < end; ++i) {
            here.set(from, places[i], k);
            there.set(to, feet[i], k);
            for (std::size_t a = 0; a < list.size(); ++a) {
                for (auto& v : values) v.resize(list[a].components);
                here.value(from.cloud, list[a], values[0], values[2], values[3]);
                there.value(to.cloud, list[a], values[1], values[2], values[3]);
                differences[a][i] = static_cast<float>(list[a].difference(values[0], values[1]));
            }
        }
    });
    std::vector<AttributeError> errors;
    for (std::size_t a = 0; a < list.size(); ++a) {
        // Of values that are no numbers there is no difference, nor of those farther apart than
        // single precision holds.
        std::vector<float> known, around;
        for (std::size_t i = 0; i < areas.size(); ++i) {
            if (!std::isfinite(differences[a][i])) continue;
            known.push_back(differences[a][i]);
            around.push_back(areas[i]);
        }
        if (known.empty()) continue;
        AttributeError& error =
            errors.emplace_back(summarize(list[a].name, known, around, context));
        if (!list[a].averaged) error.differing = part_above_zero(known, around);
    }
    return errors;
}

}  // namespace stipple
