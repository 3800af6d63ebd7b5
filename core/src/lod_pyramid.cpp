#include "stipple/lod_pyramid.hpp"

#include "cluster_tree.hpp"
#include "representatives.hpp"
#include "stipple/error.hpp"
#include "stipple/neighbors.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace stipple {

namespace {

[[noreturn]] void refuse(const std::string& message) {
    throw Error(ErrorCode::InvalidArgument, message);
}

}  // namespace

void validate(const LodPyramidOptions& options) {
    for (std::size_t i = 0; i < options.sizes.size(); ++i) {
        if (options.sizes[i] == 0) refuse("levels: 0 points: expected at least 1");
        if (i > 0 && options.sizes[i] <= options.sizes[i - 1]) {
            refuse("levels: " + std::to_string(options.sizes[i]) + " after " +
                   std::to_string(options.sizes[i - 1]) +
                   ": expected each to be larger than the one before");
        }
    }
    constexpr std::size_t kMaxLevels = 64;
    if (options.sizes.size() > kMaxLevels) {
        refuse("levels: " + std::to_string(options.sizes.size()) + " of them: expected at most 64");
    }
    if (!(options.ratio > 1 && options.ratio <= 64)) {
        std::ostringstream text;
        text << "ratio " << options.ratio << ": expected above 1, at most 64";
        refuse(text.str());
    }
    if (options.base_points == 0) refuse("base_points 0: expected at least 1");
}

std::vector<std::uint64_t> lod_sizes(std::uint64_t points, const LodPyramidOptions& options) {
    validate(options);
    std::vector<std::uint64_t> sizes;
    if (options.sizes.empty()) {
        sizes.push_back(points);
        while (sizes.back() > options.base_points) {
            const double next = std::round(static_cast<double>(sizes.back()) / options.ratio);
            // Rounding must not keep a ratio near 1 from ever getting there.
            sizes.push_back(std::max<std::uint64_t>(
                1, std::min(static_cast<std::uint64_t>(next), sizes.back() - 1)));
        }
        std::ranges::reverse(sizes);
    } else {
        for (const std::uint64_t size : options.sizes) sizes.push_back(std::min(size, points));
        sizes.erase(std::ranges::unique(sizes).begin(), sizes.end());
    }
    return sizes;
}

void build_lod_pyramid(const PointCloud& cloud, const LodPyramidOptions& options,
                       const std::function<void(LodLevel&&)>& on_level, const RunContext& context) {
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    const std::vector<std::uint64_t> sizes = lod_sizes(cloud.size(), options);
    const std::vector<Reduction> reductions =
        reductions_for(cloud, options.reductions, options.representative);
    context.checkpoint(0.0);
    // The finest cut first: it grows the tree for all others.
    ClusterTree tree(cloud.positions);
    std::vector<std::vector<Index>> offsets(sizes.size());
    for (std::size_t level = sizes.size(); level-- > 0;) {
        if (sizes[level] < cloud.size()) offsets[level] = tree.cut(sizes[level], context).offsets;
    }
    for (unsigned level = 0; level < sizes.size(); ++level) {
        LodLevel result{level, {}, 0.0};
        if (offsets[level].empty()) {
            result.cloud = cloud;
        } else {
            result.cloud =
                representatives(cloud, MemberLists{tree.members().data(), offsets[level]},
                                options.representative, reductions, context);
        }
        result.spacing = mean_spacing(result.cloud.positions, context);
        on_level(std::move(result));
        context.checkpoint(static_cast<double>(level + 1) / static_cast<double>(sizes.size()));
    }
}

}  // namespace stipple
