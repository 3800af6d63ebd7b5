#pragma once

#include "samples.hpp"

#include <array>
#include <cstddef>
#include <vector>

namespace stipple {

/// The plane that splits a cluster: what lies on the side of `-normal` goes left.
struct SplitPlane {
    std::array<float, 3>
        reference;  ///< near the cluster, so that differences to it are exact enough
    std::array<float, 3> normal;
    float offset;  ///< of the plane from the reference, along the normal
};

/// Sums over samples of d, then of the upper triangle of d d^T, with d the difference to a
/// reference: x y z xx xy xz yy yz zz.
using SampleSums = std::array<double, 9>;

/// The two inner loops of the clustering, for one instruction set. Every set gives the same bits:
/// the lanes of a sum are eight, whatever the width of the machine's.
struct ClusterKernels {
    const char* name;
    /// Moves the samples left of the plane to the front and the others behind them, both in their
    /// order; `scratch` is as large. @return how many are left.
    std::size_t (*partition)(const MutableSampleSpan& samples, const SplitPlane& plane,
                             const MutableSampleSpan& scratch) noexcept;
    SampleSums (*sums)(const SampleSpan& samples, const std::array<float, 3>& reference) noexcept;
};

/// What this machine can run, the plainest first.
std::vector<ClusterKernels> available_cluster_kernels();

/// The quickest of them.
const ClusterKernels& cluster_kernels();

}  // namespace stipple
