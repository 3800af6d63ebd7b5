#pragma once

#include "cloud/samples.hpp"
#include "stipple/clusters.hpp"
#include "stipple/run_context.hpp"

#include <map>
#include <span>
#include <string>
#include <vector>

namespace stipple {

/// How what many points carry becomes that of one.
struct Reductions {
    std::vector<Reduction> attributes{};                          ///< one for each of the cloud
    Reduction color = Reduction::Mean, normal = Reduction::Mean;  ///< or `Nearest`
};

/// How the attributes of `cloud` are reduced: as `named` says, where `color` and `normal` are those
/// of the cloud; else with its point, where that is the representative, or as the attribute itself
/// says.
/// @throws Error(InvalidArgument) for a name that the cloud has not, naming those it has; for a
/// policy of colours or normals other than `Mean` and `Nearest`.
Reductions reductions_for(const PointCloud& cloud, const std::map<std::string, Reduction>& named,
                          Representative kind);

/// Some of a cloud's points for each of many places, flat; a point may be in several lists, a list
/// is never empty.
struct MemberLists {
    const Index* members;
    std::span<const Index> offsets;
    SampleSpan ordered{};  ///< the points of all lists, one list behind the other, where they are
                           ///< at hand: then `members` is its `index`

    std::size_t size() const noexcept { return offsets.size() - 1; }
    std::span<const Index> of(std::size_t i) const noexcept {
        return {members + offsets[i], members + offsets[i + 1]};
    }
};

/// The cloud with a point at each of `positions`, whose attributes are those of the points listed
/// for it, reduced.
///
/// @param nearest  for each, the listed point nearest to it; may be empty when the cloud has
/// neither normals nor attributes, and its colours are means.
PointCloud merged_cloud(const PointCloud& cloud, std::vector<Vec3f> positions,
                        const MemberLists& lists, std::span<const Index> nearest,
                        const Reductions& reductions, const RunContext& context);

/// The same for methods that place points freely: attributes are reduced by their own policy, or as
/// `reductions` says by name.
PointCloud merged_cloud(const PointCloud& cloud, std::vector<Vec3f> positions,
                        const MemberLists& lists,
                        const std::map<std::string, Reduction>& reductions,
                        const RunContext& context);

/// For each position the listed point nearest to it, the smaller number among equals.
std::vector<Index> nearest_members(std::span<const Vec3f> points, const MemberLists& lists,
                                   std::span<const Vec3f> positions, const RunContext& context);

/// The cloud of representatives of clusters of its points.
PointCloud representatives(const PointCloud& cloud, const MemberLists& clusters,
                           Representative kind, const Reductions& reductions,
                           const RunContext& context);

}  // namespace stipple
