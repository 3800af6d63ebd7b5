#pragma once

#include "cluster_tree.hpp"
#include "stipple/clusters.hpp"

#include <map>
#include <string>

namespace stipple {

/// How each attribute of `cloud` is reduced: as `named` says; else with its point, where that is
/// the representative, or as the attribute itself says.
/// @throws Error(InvalidArgument) for a name that the cloud has not, naming those it has.
std::vector<Reduction> reductions_for(const PointCloud& cloud,
                                      const std::map<std::string, Reduction>& named,
                                      Representative kind);

/// The cloud of representatives of the clusters of `cut`, whose samples' positions and numbers are
/// those of `cloud`.
/// @param reductions  one for each attribute of `cloud`.
PointCloud representatives(const PointCloud& cloud, const SampleSpan& samples, const Cut& cut,
                           Representative kind, std::span<const Reduction> reductions,
                           const RunContext& context);

}  // namespace stipple
