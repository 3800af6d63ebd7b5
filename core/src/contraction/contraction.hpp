#pragma once

#include "contraction/quadric.hpp"
#include "stipple/iterative_simplification.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

namespace stipple {

/// What point-pair contraction has come to at some count.
struct ContractionSnapshot {
    std::vector<Vec3f> positions;    ///< of the survivors
    std::vector<Index> samples;      ///< for each survivor the sample that it is, with
                                     ///< `Placement::EndPoint`; else empty
    std::vector<Index> survivor_of;  ///< for each sample, the survivor that stands for it
    /// Of the survivors, relative to their positions, in the unit of the input times
    /// `contraction_scale` of the samples; empty with `Placement::EndPoint`.
    std::vector<StoredQuadric> quadrics;
};

/// A contraction: the numbers of the sample that stayed and of the one that went into it.
using ContractionPair = std::pair<Index, Index>;

/// What a sample adds to its quadric beside its planes: so much of their weight times the squared
/// distance to itself. It spreads the samples evenly where planes leave them free to slide, and
/// makes every minimiser one well-defined point.
inline constexpr double kPointTerm = 1e-3;

/// The same for each unit of roughness, which is the mean squared slope of the edges: where the
/// surface is rough, its planes tell little, and there have to be more points.
inline constexpr double kRoughnessTerm = 1;

struct ContractionOptions {
    unsigned k = 6;  ///< neighbours of a sample at the start and capacity of its list after, 3..32
    Placement placement = Placement::Optimal;
    /// Values for each sample, as many as `channels`, that the quadrics made here keep together
    /// (colours, scalars): a difference of 1 counts as a distance of 1 in input units. Sample by
    /// sample; empty when `channels` is 0.
    std::span<const float> features{};
    unsigned channels = 0;
    /// Where set, every contraction of the run in order is written here; a snapshot of n of N
    /// samples is what the first N - n of them make.
    std::vector<ContractionPair>* sequence = nullptr;
};

/// The power of two that brings positions to a size of about 1, where squares of squares neither
/// under- nor overflow. Quadrics given to `contract` are those of positions times this.
double contraction_scale(std::span<const Vec3f> positions, const RunContext& context);

/// Point-pair contraction (§3.2) from all samples down to the last of `counts`, in rounds.
///
/// @param quadrics  one for each sample, relative to its position: what it stands for as planes and
///        points (`add_plane`, `add_point` with `kPointTerm` of the planes' weight), each weighted
///        by its area; the scale of weights is free, but one for all. Empty: made here, from the
///        planes of the edges to the k nearest neighbours.
/// @param counts  descending, each at least 1 and at most the number of samples.
/// @param on_snapshot  called for each count, on the calling thread. A snapshot does not depend on
///        the other counts.
/// @throws Error(TooLarge) from 2^31 samples on.
/// Expected O(N log N), parallel; 72 + 4 k bytes a sample while more than half are left.
void contract(std::span<const Vec3f> positions, std::span<const StoredQuadric> quadrics,
              std::span<const std::uint64_t> counts, const ContractionOptions& options,
              const std::function<void(ContractionSnapshot&&)>& on_snapshot,
              const RunContext& context);

}  // namespace stipple
