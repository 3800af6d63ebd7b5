#include "stipple/simplify.hpp"

#include "stipple/error.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace stipple {

namespace {

[[noreturn]] void refuse(const std::string& message) {
    throw Error(ErrorCode::InvalidArgument, message);
}

}  // namespace

std::string_view to_string(Method method) noexcept {
    switch (method) {
        case Method::Hierarchical:
            break;
    }
    return "hierarchical";
}

Method method_from_name(std::string_view name) {
    if (name == to_string(Method::Hierarchical)) return Method::Hierarchical;
    refuse("method " + std::string(name) + ": expected hierarchical");
}

void validate(const SimplifyOptions& options) {
    const bool bounded =
        options.hierarchical.max_cluster_size || options.hierarchical.max_variation;
    if (int{options.points.has_value()} + int{options.ratio.has_value()} + int{bounded} != 1) {
        refuse(
            "target: expected exactly one of points, ratio, or max_cluster_size and max_variation");
    }
    if (options.points && *options.points == 0) refuse("points 0: expected at least 1");
    if (options.ratio && !(*options.ratio > 0 && *options.ratio <= 1)) {
        std::ostringstream text;
        text << "ratio " << *options.ratio << ": expected above 0, at most 1";
        refuse(text.str());
    }
}

PointCloud simplify(const PointCloud& cloud, const SimplifyOptions& options,
                    const RunContext& context) {
    validate(options);
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    HierarchicalClusteringOptions hierarchical = options.hierarchical;
    hierarchical.reductions.insert(options.reductions.begin(), options.reductions.end());
    if (options.points) hierarchical.target_size = *options.points;
    if (options.ratio) {
        const double wanted = std::round(*options.ratio * static_cast<double>(cloud.size()));
        hierarchical.target_size = static_cast<std::uint64_t>(std::max(1.0, wanted));
    }
    return hierarchical_clustering(cloud, hierarchical, context);
}

}  // namespace stipple
