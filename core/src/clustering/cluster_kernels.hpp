#pragma once

#include "base/symmetric_eigen.hpp"
#include "cloud/samples.hpp"

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

/// The extreme eigenvalues of a scatter matrix and the unit vector of the largest.
struct Spread {
    double smallest = 0, largest = 0;
    Vec3d direction = Vec3d::UnitX();
};

/// How many spreads are taken at once.
constexpr std::size_t kSpreads = 4;

/// The least box around some samples.
struct SampleBox {
    std::array<float, 3> low, high;
};

/// Eight boxes; one that is missing is infinitely far from everything.
struct alignas(32) EightBoxes {
    std::array<std::array<float, 8>, 3> low, high;
};

/// Samples in blocks, of which some are taken; eight more can be read.
struct SampleBlocks {
    SampleSpan samples;
    const float* taken;       ///< 0 or less where a sample is free
    const Index* begins;      ///< of each block; one more for the end
    const EightBoxes* boxes;  ///< of blocks 0..7, 8..15, ...
};

/// What `nearby` looks for.
struct NearbyQuery {
    std::array<float, 3> center;
    float counted_sq, limit_sq;
    Index begin, end;     ///< the samples that may be looked at, whole blocks
    std::size_t at_most;  ///< to be found, and those of eight blocks
};

/// Where `nearby` writes, packed: squared distances of all samples that it counts; and of the free
/// ones that it finds, beside their places. Eight more than those are written.
struct NearbyOutput {
    float *all_sq, *free_sq;
    Index* free;
    bool is_beyond = false;  ///< whether samples that may not be looked at may be near
};

/// The inner loops of the clustering methods, for one instruction set. Every set gives the same
/// bits: the lanes of a sum are eight, whatever the width of the machine's.
struct ClusterKernels {
    const char* name;
    /// Writes the samples left of the plane to the front of `to` and the others behind them, in an
    /// order that depends on nothing but the samples; `to` is another place of the same size.
    /// @return how many are left.
    std::size_t (*partition)(const SampleSpan& samples, const SplitPlane& plane,
                             const MutableSampleSpan& to) noexcept;
    SampleSums (*sums)(const SampleSpan& samples, const std::array<float, 3>& reference) noexcept;
    /// As `eigenvalues` and `eigenvector` of symmetric_eigen.hpp, up to rounding, for four
    /// matrices.
    std::array<Spread, kSpreads> (*spreads)(
        const std::array<Symmetric3, kSpreads>& scatters) noexcept;
    /// Of the blocks of `count` groups of eight, counts all samples within the root of `counted_sq`
    /// of the center, and finds the free ones within that of `limit_sq`, which is no less.
    /// @return behind what was written.
    NearbyOutput (*nearby)(const SampleBlocks& blocks, const Index* groups, std::size_t count,
                           const NearbyQuery& query, const NearbyOutput& out) noexcept;
    /// Which boxes have a part within the root of `radius_sq` of the center, as bits.
    unsigned (*boxes_within)(const EightBoxes& boxes, const std::array<float, 3>& center,
                             float radius_sq) noexcept;
    /// Of at least one sample.
    SampleBox (*box)(const SampleSpan& samples) noexcept;
    /// How many of the values are at most `limit`. Reads up to seven more, which count as well.
    std::size_t (*count)(const float* values, std::size_t size, float limit) noexcept;
    /// Writes the values above `low` and at most `high` to `out`, packed, and seven more. Reads as
    /// `count` does. @return how many there are.
    std::size_t (*values_between)(const float* values, std::size_t size, float low, float high,
                                  float* out) noexcept;
    /// The same of the places beside such values.
    std::size_t (*places_between)(const float* values, const Index* places, std::size_t size,
                                  float low, float high, Index* out) noexcept;
};

/// What this machine can run, the plainest first.
std::vector<ClusterKernels> available_cluster_kernels();

/// The quickest of them.
const ClusterKernels& cluster_kernels();

}  // namespace stipple
