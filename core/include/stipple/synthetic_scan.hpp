#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>

namespace stipple {

struct SyntheticScanOptions {
    std::uint64_t points = 1'000'000;  ///< N in 1..2^32 - 1: exactly this many
    std::uint64_t seed = 1;            ///< another seed gives other samples, holes, stone and glaze
    double noise = 0.08;               ///< standard deviation along the normal, in mm, in 0..10
};

/// @throws Error(InvalidArgument) for an option out of range.
void validate(const SyntheticScanOptions& options);

/// A cloud like that of a laser scanner, for experiments without a scan: an ammonite on a stone
/// plinth, 155 mm wide and 181 mm high, y up.
///
/// It has what makes real scans hard: relief from coarse ribs to fine growth lines, sharp creases
/// (keel, plinth), thin parts (the rod that carries the shell; its wall at the mouth, seen from
/// both sides), whorls that almost touch, noise, holes, a missing underside, and density that
/// follows the lines of the scanner. Points have normals, colours and a float attribute `intensity`
/// in [0, 1]; they run along the surface, part by part, as a scanner delivers them.
///
/// The same options give the same bytes on any number of threads and any machine with IEEE
/// arithmetic: every point has its own random generator, and sqrt is the only function of the
/// system's mathematics library used.
///
/// @throws Error as `validate`.
///
/// O(N), parallel, about 1 µs per point and thread.
PointCloud synthetic_scan(const SyntheticScanOptions& options = {}, const RunContext& context = {});

}  // namespace stipple
