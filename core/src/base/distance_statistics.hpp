#pragma once

#include "stipple/run_context.hpp"
#include "stipple/surface_error.hpp"

#include <span>

namespace stipple {

/// Sums a list of differences up, each with the area that it stands for: maximum, mean, root mean
/// square. Areas are not negative, and not all zero.
AttributeError summarize(std::string name, std::span<const float> differences,
                         std::span<const float> areas, const RunContext& context = {});

/// How far the mean is from that for infinitely many samples, in 95 of 100 cases at most: by how
/// much samples differ that follow each other, as neighbours do, drawn one from each of as many
/// parts of the surface. 0 for one sample.
double mean_confidence(std::span<const float> distances, std::span<const float> areas, double mean,
                       const RunContext& context = {});

/// All of a `DirectedError` that distances say.
DirectedError summarize_distances(std::span<const float> distances, std::span<const float> areas,
                                  unsigned histogram_bins, const RunContext& context = {});

/// For each of `parts`, the least of the values that so much of the weight does not exceed. Values
/// are not negative. O(N).
std::vector<double> weighted_quantiles(std::span<const float> values,
                                       std::span<const float> weights,
                                       std::span<const double> parts,
                                       const RunContext& context = {});

/// Lowers the largest of some weights until none is more than a fiftieth of all, or eight times the
/// mean where there are few: one of a stray point far off would else be all that counts. O(N) for
/// each time that lowering some makes others the largest.
void limit_largest(std::span<float> weights);

}  // namespace stipple
