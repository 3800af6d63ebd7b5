#include "error/plane_kernels.hpp"

#include "base/kernel_sets.hpp"

namespace stipple {

namespace {
#define STIPPLE_KERNELS_BODY "error/plane_kernels_body.hpp"
#include "base/kernel_sets_of_body.hpp"
}  // namespace

std::vector<PlaneKernel> available_plane_kernels() {
    return with_avx2<PlaneKernel>({"plain", plain::run}, {"avx2", avx2::run});
}

const PlaneKernel& plane_kernel() {
    static const std::vector<PlaneKernel> available = available_plane_kernels();
    return quickest(available);
}

}  // namespace stipple
