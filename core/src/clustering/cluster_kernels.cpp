#include "clustering/cluster_kernels.hpp"

#include "base/kernel_sets.hpp"
#include "cloud/float4.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <type_traits>

namespace stipple {

namespace {
#define STIPPLE_KERNELS_BODY "clustering/cluster_kernels_body.hpp"
#include "base/kernel_sets_of_body.hpp"
}  // namespace

std::vector<ClusterKernels> available_cluster_kernels() {
    return with_avx2<ClusterKernels>(
        {"plain", plain::partition, plain::sums, plain::spreads, plain::nearby, plain::boxes_within,
         plain::box, plain::count, plain::values_between, plain::places_between},
        {"avx2", avx2::partition, avx2::sums, avx2::spreads, avx2::nearby, avx2::boxes_within,
         avx2::box, avx2::count, avx2::values_between, avx2::places_between});
}

const ClusterKernels& cluster_kernels() {
    static const std::vector<ClusterKernels> available = available_cluster_kernels();
    return quickest(available);
}

}  // namespace stipple
