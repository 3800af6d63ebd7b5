#include "curve_normals.hpp"

#include "first_touch.hpp"
#include "normal_kernels.hpp"
#include "parallel_for.hpp"

#include <array>
#include <cstddef>
#include <cstdint>

namespace stipple {

std::vector<NormalAndBend> curve_normals(const PointTree& tree, const RunContext& context) {
    constexpr std::size_t kLeaves = 1'024;
    auto normals = made_in_blocks<std::vector<NormalAndBend>>(tree.size(), context);
    const NormalKernel kernel = normal_kernel();
    parallel_for_blocks(
        tree.leaf_count(), kLeaves, context, [&](std::size_t begin, std::size_t end) {
            std::array<float, PointTree::kWidth> x, y, z, bend;
            for (std::size_t l = begin; l < end; ++l) {
                kernel.leaf_normals(tree.view(), static_cast<std::uint32_t>(l), x.data(), y.data(),
                                    z.data(), bend.data());
                for (std::size_t lane = 0; lane < tree.points_in(l); ++lane)
                    normals[tree.leaf(l).index[lane]] = {{x[lane], y[lane], z[lane]}, bend[lane]};
            }
        });
    return normals;
}

}  // namespace stipple
