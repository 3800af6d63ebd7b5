#include "analysis/mls_kernels.hpp"

#include "base/kernel_sets.hpp"

#include <cstdint>

namespace stipple {

namespace {
#define STIPPLE_KERNELS_BODY "analysis/mls_kernels_body.hpp"
#include "base/kernel_sets_of_body.hpp"
}  // namespace

std::vector<MlsKernels> available_mls_kernels() {
    return with_avx2<MlsKernels>(
        {"plain", plain::weigh, plain::moments, plain::derivatives, plain::normal_equations},
        {"avx2", avx2::weigh, avx2::moments, avx2::derivatives, avx2::normal_equations});
}

const MlsKernels& mls_kernels() {
    static const std::vector<MlsKernels> available = available_mls_kernels();
    return quickest(available);
}

}  // namespace stipple
