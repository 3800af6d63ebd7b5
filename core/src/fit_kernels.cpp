#include "fit_kernels.hpp"

#include "kernel_sets.hpp"

#include <cstdint>

namespace stipple {

namespace {
#define STIPPLE_KERNELS_BODY "fit_kernels_body.hpp"
#include "kernel_sets_of_body.hpp"
}  // namespace

std::vector<FitKernel> available_fit_kernels() {
    return with_avx2<FitKernel>({"plain", plain::run}, {"avx2", avx2::run});
}

const FitKernel& fit_kernel() {
    static const std::vector<FitKernel> available = available_fit_kernels();
    return quickest(available);
}

}  // namespace stipple
