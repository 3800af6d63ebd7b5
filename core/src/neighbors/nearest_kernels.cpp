#include "neighbors/nearest_kernels.hpp"

#include "base/kernel_sets.hpp"
#include "cloud/float4.hpp"

#include <climits>
#include <cstdint>
#include <limits>

namespace stipple {

namespace {
#define STIPPLE_KERNELS_BODY "neighbors/nearest_kernels_body.hpp"
#include "base/kernel_sets_of_body.hpp"
}  // namespace

std::vector<NearestKernels> available_nearest_kernels() {
    return with_avx2<NearestKernels>({"plain", plain::gather, plain::choose, plain::rank,
                                      plain::nearest, plain::within, plain::around, plain::spread},
                                     {"avx2", avx2::gather, avx2::choose, avx2::rank, avx2::nearest,
                                      avx2::within, avx2::around, avx2::spread});
}

const NearestKernels& nearest_kernels() {
    static const std::vector<NearestKernels> available = available_nearest_kernels();
    return quickest(available);
}

}  // namespace stipple
