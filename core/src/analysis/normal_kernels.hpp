#pragma once

#include "neighbors/point_tree.hpp"

#include <cstdint>
#include <vector>

namespace stipple {

/// The inner loop of `curve_normals`, for one instruction set. Every set gives the same bits.
struct NormalKernel {
    const char* name;

    /// For each of the eight points of a leaf the unit normal of the surface there, by the points
    /// in this leaf and the two beside it on the curve, all finite: of the plane of weighted least
    /// squares, up where there is none; and the mean curvature, above 0 where the surface bends
    /// towards the normal, 0 where there is no plane. Anything for points that the leaf is short
    /// of.
    void (*leaf_normals)(const PointTree::View& tree, std::uint32_t leaf, float* x, float* y,
                         float* z, float* curvature) noexcept;
};

/// What this machine can run, the plainest first.
std::vector<NormalKernel> available_normal_kernels();

/// The quickest of them.
const NormalKernel& normal_kernel();

}  // namespace stipple
