#include "analysis/normal_kernels.hpp"

#include "base/kernel_sets.hpp"

#include <array>
#include <cstddef>

namespace stipple {

namespace {
#define STIPPLE_KERNELS_BODY "analysis/normal_kernels_body.hpp"
#include "base/kernel_sets_of_body.hpp"
}  // namespace

std::vector<NormalKernel> available_normal_kernels() {
    return with_avx2<NormalKernel>({"plain", plain::leaf_normals}, {"avx2", avx2::leaf_normals});
}

const NormalKernel& normal_kernel() {
    static const std::vector<NormalKernel> available = available_normal_kernels();
    return quickest(available);
}

}  // namespace stipple
