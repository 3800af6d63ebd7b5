#include "cloud/kept_points.hpp"

#include "base/parallel_for.hpp"

#include <algorithm>
#include <variant>
#include <vector>

namespace stipple {

namespace {

template <typename T>
void keep(std::vector<T>& values, std::span<const std::uint8_t> marks, unsigned components,
          const RunContext& context) {
    if (values.empty()) return;
    std::size_t out = 0;
    for_blocks_in_order(marks.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            if (marks[i] != 0) continue;
            if (out != i)
                std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(i * components),
                            components,
                            values.begin() + static_cast<std::ptrdiff_t>(out * components));
            ++out;
        }
    });
    values.resize(out * components);
}

}  // namespace

void keep_unmarked(PointCloud& cloud, std::span<const std::uint8_t> marks,
                   const RunContext& context) {
    keep(cloud.positions, marks, 1, context);
    keep(cloud.normals, marks, 1, context);
    keep(cloud.colors, marks, 1, context);
    for (Attribute& attribute : cloud.attributes) {
        std::visit([&](auto& values) { keep(values, marks, attribute.components, context); },
                   attribute.values);
    }
}

}  // namespace stipple
