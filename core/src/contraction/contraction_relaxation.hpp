#pragma once

#include "contraction/quadric.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <vector>

namespace stipple {

/// Samples with their quadrics, shared out among survivors.
struct SharedSamples {
    std::vector<Vec3f> positions;
    std::vector<StoredQuadric> quadrics;  ///< relative to the positions
    std::vector<Index> survivor_of;       ///< for each, whose quadric its own is part of
};

/// Gives each sample to the survivor in its neighbourhood that it is nearest to by its own quadric,
/// and moves each survivor to the minimiser of what it has got; again and again. Contraction alone
/// is greedy: what it once joined stays together.
///
/// @param survivors  positions, each with at least one sample; it keeps at least one.
/// @param rounds  how often; 0 leaves all as it is.
void relax(SharedSamples& samples, std::vector<Vec3f>& survivors, unsigned rounds,
           const RunContext& context);

}  // namespace stipple
