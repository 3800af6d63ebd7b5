#pragma once

#include "contraction/contraction.hpp"
#include "stipple/hierarchical_clustering.hpp"
#include "stipple/point_cloud.hpp"

#include <set>
#include <utility>
#include <vector>

// The slow obvious forms that the fast ones are held against.
namespace stipple::test {

/// (squared distance, index) of every other point, sorted, of point i.
std::vector<std::pair<float, Index>> sorted_distances(const std::vector<Vec3f>& points,
                                                      std::size_t i);

/// The paper's recursion (§3.1) by the letter: covariance in doubles, split at the centroid, no
/// shared state.
std::set<std::set<Index>> recursive_clusters(const std::vector<Vec3f>& points, std::size_t max_size,
                                             double max_variation);

/// Point-pair contraction one pair at a time (§3.2), the cheapest of all first, without relaxation;
/// quadrics in units of `scale`.
ContractionSnapshot contract_by_queue(const std::vector<Vec3f>& points,
                                      const std::vector<StoredQuadric>& quadrics, double scale,
                                      std::size_t count, std::size_t k);

}  // namespace stipple::test
