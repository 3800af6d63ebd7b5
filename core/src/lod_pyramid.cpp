#include "stipple/lod_pyramid.hpp"

#include "cloud_copy.hpp"
#include "cluster_tree.hpp"
#include "representatives.hpp"
#include "stipple/error.hpp"
#include "stipple/neighbors.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

namespace stipple {

namespace {

[[noreturn]] void refuse(const std::string& message) {
    throw Error(ErrorCode::InvalidArgument, message);
}

void cut_levels(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                const LodPyramidOptions& options, const std::function<void(PointCloud&&)>& emit,
                const RunContext& context) {
    const std::vector<Reduction> reductions =
        reductions_for(cloud, options.reductions, options.representative);
    // The finest cut first: it grows the tree for all others.
    ClusterTree tree(cloud.positions);
    std::vector<std::vector<Index>> offsets(sizes.size());
    for (std::size_t level = sizes.size(); level-- > 0;) {
        offsets[level] = tree.cut(sizes[level], context).offsets;
    }
    for (const std::vector<Index>& cut : offsets) {
        emit(representatives(cloud, MemberLists{tree.members().data(), cut}, options.representative,
                             reductions, context));
    }
}

/// Coarsest first.
std::vector<PointCloud> snapshots(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                                  const LodPyramidOptions& options, const RunContext& context) {
    const std::vector<std::uint64_t> finest_first(sizes.rbegin(), sizes.rend());
    std::vector<PointCloud> levels;
    const auto keep = [&levels](PointCloud&& made) { levels.push_back(std::move(made)); };
    IterativeSimplificationOptions contraction;
    contraction.reductions = options.reductions;
    if (options.method == Method::Iterative) {
        iterative_snapshots(cloud, finest_first, contraction, keep, context);
    } else {
        multiphase_snapshots(cloud, finest_first, {.contraction = contraction}, keep, context);
    }
    std::ranges::reverse(levels);
    return levels;
}

}  // namespace

void validate(const LodPyramidOptions& options) {
    constexpr std::array kWithLevels = {Method::Hierarchical, Method::Multiphase,
                                        Method::Iterative};
    if (std::ranges::find(kWithLevels, options.method) == kWithLevels.end()) {
        refuse("method " + std::string(to_string(options.method)) +
               ": expected hierarchical, multiphase or iterative for a pyramid");
    }
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
    std::span<const std::uint64_t> made(sizes);  // all but the whole cloud, which is there
    if (made.back() == cloud.size()) made = made.first(made.size() - 1);
    const bool cuts = options.method == Method::Hierarchical;
    const double begin = cuts ? 0 : 0.8;  // snapshots are there when the first level comes

    unsigned level = 0;
    const auto emit = [&](PointCloud&& next) {
        const double spacing = options.spacing ? mean_spacing(next.positions, context) : 0.0;
        on_level({level, std::move(next), spacing});
        ++level;
        context.checkpoint(begin + (1 - begin) * static_cast<double>(level) /
                                       static_cast<double>(sizes.size()));
    };
    context.checkpoint(0.0);
    if (cuts) {
        cut_levels(cloud, made, options, emit, context);
    } else if (!made.empty()) {
        for (PointCloud& next : snapshots(cloud, made, options, context.part(0, begin)))
            emit(std::move(next));
    }
    if (made.size() < sizes.size()) emit(copy_of(cloud, context));
}

}  // namespace stipple
