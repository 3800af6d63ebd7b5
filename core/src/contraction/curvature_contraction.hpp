#pragma once

#include "contraction/contraction.hpp"

namespace stipple {

/// Takes a snapshot, and tells its own progress with it.
using OnContracted = std::function<void(ContractionSnapshot&&, const RunContext&)>;

/// What is contracted: a cloud, or a snapshot of one.
struct CurvatureInput {
    std::span<const Vec3f> positions;
    std::span<const StoredQuadric> quadrics = {};  ///< as of `contract`
    std::size_t points = 0;  ///< that positions with quadrics stand for; 0: each for itself
    std::uint64_t next = 0;  ///< of the counts, that whose snapshot is to have its quadrics, as
                             ///< they are wanted here; the others have none
};

/// Point-pair contraction (§3.2) that leaves more points where the surface bends.
///
/// Contracts to 8 samples for each survivor; measures how much the surface through these bends,
/// adds to the quadric of each as much of the squared distance to it, and contracts them to the
/// count; then shares them out anew (`relax`).
///
/// @param counts, on_snapshot, options  as of `contract`; placement is optimal.
/// @throws as `contract`. What that costs, and for each snapshot of n points the same again for 8 n
/// points, one after the other, with 200 bytes more for each of them.
void contract_by_curvature(const CurvatureInput& input, std::span<const std::uint64_t> counts,
                           const ContractionOptions& options, const OnContracted& on_snapshot,
                           const RunContext& context);

/// How much the surface bends at each of some points, and how much of it they stand for.
struct Bends {
    std::vector<float>
        curvatures;            ///< mean curvature of either sign, averaged over the 12 nearest,
                               ///< within a factor that is the same for all; in 1 / input unit
    std::vector<float> areas;  ///< mean squared distance of the 12 nearest
};

/// Curvatures are 0 on a plane and where points coincide or are fewer than 3. O(N), parallel; 80
/// bytes a point. @param points  of a size of about 1, so that no square under- or overflows.
Bends bends_of(std::span<const Vec3f> points, const RunContext& context);

}  // namespace stipple
