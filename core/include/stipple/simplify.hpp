#pragma once

#include "stipple/hierarchical_clustering.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace stipple {

enum class Method {
    Hierarchical,  ///< binary space partition (§3.1)
};

/// `hierarchical`: the name on the wire and in the command line.
std::string_view to_string(Method method) noexcept;
/// @throws Error(InvalidArgument) naming the methods there are.
Method method_from_name(std::string_view name);

/// What to do to a cloud: one method, and one target.
struct SimplifyOptions {
    Method method = Method::Hierarchical;
    std::optional<std::uint64_t>
        points{};  ///< N' >= 1: exactly so many; all of them when there are fewer
    std::optional<double>
        ratio{};  ///< in (0, 1]: exactly max(1, round(ratio * N)), N counted after cleaning
    HierarchicalClusteringOptions
        hierarchical;  ///< `target_size` is set from the target; bounds stand instead of one
    std::map<std::string, Reduction>
        reductions{};        ///< by attribute name, instead of the attribute's own
    std::uint64_t seed = 0;  ///< for methods that draw at random
};

/// Checks what can be checked without a cloud. @throws Error(InvalidArgument).
void validate(const SimplifyOptions& options);

/// Simplifies a cleaned cloud (`clean`) by any method. The result has exactly the points asked for,
/// or all there are when the target is above the count; every attribute of the input survives.
/// @throws Error(InvalidArgument) for options out of range or a cloud without points.
PointCloud simplify(const PointCloud& cloud, const SimplifyOptions& options,
                    const RunContext& context = {});

}  // namespace stipple
