#include "contraction/fit_kernels.hpp"

#include "base/kernel_sets.hpp"
#include "clustering/layers.hpp"

#include <cstdint>

namespace stipple {

namespace {
#define STIPPLE_KERNELS_BODY "contraction/fit_kernels_body.hpp"
#include "base/kernel_sets_of_body.hpp"
}  // namespace

std::vector<FitKernel> available_fit_kernels() {
    return with_avx2<FitKernel>(
        {"plain", plain::run, plain::layers, plain::want, plain::look_along},
        {"avx2", avx2::run, avx2::layers, avx2::want, avx2::look_along});
}

const FitKernel& fit_kernel() {
    static const std::vector<FitKernel> available = available_fit_kernels();
    return quickest(available);
}

}  // namespace stipple
