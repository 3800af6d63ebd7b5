#include "analysis/covariance_kernels.hpp"

#include "base/kernel_sets.hpp"

#include <cmath>
#include <cstdint>

namespace stipple {

namespace {
#define STIPPLE_KERNELS_BODY "analysis/covariance_kernels_body.hpp"
#include "base/kernel_sets_of_body.hpp"
}  // namespace

std::vector<CovarianceKernels> available_covariance_kernels() {
    return with_avx2<CovarianceKernels>({"plain", plain::add_moments, plain::solve},
                                        {"avx2", avx2::add_moments, avx2::solve});
}

const CovarianceKernels& covariance_kernels() {
    static const std::vector<CovarianceKernels> available = available_covariance_kernels();
    return quickest(available);
}

}  // namespace stipple
