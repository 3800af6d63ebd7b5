#include "analysis/curve_normals.hpp"

#include "analysis/normal_kernels.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace stipple {

namespace {

using Floats = std::array<float, PointTree::kWidth>;

/// The normals and bends of a leaf.
struct LeafNormals {
    Floats x, y, z, bend;

    Vec3f normal(std::size_t lane) const { return {x[lane], y[lane], z[lane]}; }

    /// What the point sees as far as the leaf sees it, too: noise bends each to another side.
    float shared_bend(std::size_t lane, std::size_t count) const {
        constexpr float kMost = 2;  // times the mean
        const Vec3f up = normal(lane);
        float sum = 0;
        for (std::size_t i = 0; i < count; ++i) sum += up.dot(normal(i)) < 0 ? -bend[i] : bend[i];
        const float most = kMost * sum / static_cast<float>(count);
        return std::clamp(bend[lane], std::min(most, 0.0F), std::max(most, 0.0F));
    }
};

}  // namespace

std::vector<NormalAndBend> curve_normals(const PointTree& tree, const RunContext& context) {
    constexpr std::size_t kLeaves = 1'024;
    auto normals = made_in_blocks<std::vector<NormalAndBend>>(tree.size(), context);
    const NormalKernel kernel = normal_kernel();
    parallel_for_blocks(
        tree.leaf_count(), kLeaves, context, [&](std::size_t begin, std::size_t end) {
            LeafNormals leaf;
            for (std::size_t l = begin; l < end; ++l) {
                kernel.leaf_normals(tree.view(), static_cast<std::uint32_t>(l), leaf.x.data(),
                                    leaf.y.data(), leaf.z.data(), leaf.bend.data());
                const std::size_t count = tree.points_in(l);
                for (std::size_t lane = 0; lane < count; ++lane)
                    normals[tree.leaf(l).index[lane]] = {leaf.normal(lane),
                                                         leaf.shared_bend(lane, count)};
            }
        });
    return normals;
}

}  // namespace stipple
