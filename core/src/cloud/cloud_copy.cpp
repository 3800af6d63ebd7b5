#include "cloud/cloud_copy.hpp"

#include "base/first_touch.hpp"

#include <algorithm>
#include <type_traits>

namespace stipple {

namespace {

/// A cloud of which each array is what `copy(values, components)` makes of the other's.
template <typename Copy>
PointCloud copied_by(const PointCloud& cloud, const Copy& copy) {
    PointCloud result;
    result.origin = cloud.origin;
    result.has_alpha = cloud.has_alpha;
    result.double_precision = cloud.double_precision;
    result.positions = copy(cloud.positions, 1);
    result.normals = copy(cloud.normals, 1);
    result.colors = copy(cloud.colors, 1);
    for (const Attribute& a : cloud.attributes) {
        const auto values = [&](const auto& from) -> AttributeValues {
            return copy(from, a.components);
        };
        result.attributes.push_back(
            {a.name, std::visit(values, a.values), a.components, a.reduction});
    }
    return result;
}

}  // namespace

PointCloud subset(const PointCloud& cloud, std::span<const Index> indices,
                  const RunContext& context) {
    validate(cloud);
    return copied_by(cloud, [&](const auto& values, unsigned components) {
        std::decay_t<decltype(values)> result;
        if (values.empty()) return result;
        reserve_in_blocks(result, indices.size() * components, context);
        for_blocks_in_order(indices.size(), context, [&](std::size_t begin, std::size_t end) {
            result.resize(end * components);
            auto out = result.begin() + static_cast<std::ptrdiff_t>(begin * components);
            for (const Index i : indices.subspan(begin, end - begin)) {
                const auto from = values.begin() + static_cast<std::ptrdiff_t>(i) * components;
                out = std::copy_n(from, components, out);
            }
        });
        return result;
    });
}

PointCloud copy_of(const PointCloud& cloud, const RunContext& context) {
    return copied_by(cloud, [&](const auto& values, unsigned) {
        std::decay_t<decltype(values)> result;
        reserve_in_blocks(result, values.size(), context);
        for_blocks_in_order(values.size(), context, [&](std::size_t begin, std::size_t end) {
            result.insert(result.end(), values.begin() + static_cast<std::ptrdiff_t>(begin),
                          values.begin() + static_cast<std::ptrdiff_t>(end));
        });
        return result;
    });
}

}  // namespace stipple
