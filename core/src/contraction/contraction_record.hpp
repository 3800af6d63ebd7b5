#pragma once

#include "cloud/float4.hpp"
#include "contraction/quadric.hpp"
#include "stipple/iterative_simplification.hpp"
#include "stipple/point_cloud.hpp"

#include <array>

namespace stipple {

/// All that a contraction reads of a sample, in one line of the cache, which is full: so `link` and
/// `claim` mean one thing at one time and another at another.
struct alignas(64) ContractionRecord {
    Vec3f position;
    StoredQuadric quadric;  ///< relative to the position; its c is what the sample costs already
    /// Of a sample that is left: itself, or, from its contraction with another until its list of
    /// neighbours is up to date, that other's number and the highest bit. Of one that is gone: the
    /// sample into which it was contracted.
    Index link;
    /// In a round: the sample that asks to contract with this one for the least, if any does. While
    /// quadrics are made, the sample's packed tangent; while slots are renumbered, its new number.
    Index claim;
    float cost;  ///< of the contraction with its partner
};
static_assert(sizeof(ContractionRecord) == 64);

/// Two samples as one, relative to the first.
struct JoinedSamples {
    Quadric quadric;
    Vec3d offset;  ///< of the new position
};

/// Where the pair goes: to the minimiser of both quadrics (§3.2), not farther from their middle
/// than they are from each other; or to the end where their sum is less, the first if equal.
JoinedSamples join(const ContractionRecord& a, const ContractionRecord& b, Placement placement);

/// What it costs to join the four pairs a[i], b[i]: what that adds to the quadrics' least values,
/// times the distance of the two. In floats, relative to `a`: what is lost of the costs is far less
/// than the point term adds.
Float4 costs_of_joining(const std::array<const ContractionRecord*, 4>& a,
                        const std::array<const ContractionRecord*, 4>& b, Placement placement);

}  // namespace stipple
