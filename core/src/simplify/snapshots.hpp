#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/simplify.hpp"

#include <cstdint>
#include <functional>
#include <span>

namespace stipple {

/// The clouds of many sizes by the method of `options`, from one run where it is cuts of a
/// tree or states of a contraction, else by `runs_of`. The target of the options is not read.
///
/// @param sizes  descending, each in 1..N - 1.
/// @param on_cloud  called for each size, in their order, on the calling thread.
void make_snapshots(const PointCloud& cloud, const SimplifyOptions& options,
                    std::span<const std::uint64_t> sizes,
                    const std::function<void(PointCloud&&)>& on_cloud, const RunContext& context);

/// Makes the cloud of a size in 1..N - 1.
using CloudOfSize = std::function<PointCloud(std::uint64_t size, const RunContext& context)>;

/// By a run for each size, which takes the less the smaller it is; those of `particles` share what
/// is known of the surface. The cloud stays and does not change.
CloudOfSize runs_of(const PointCloud& cloud, const SimplifyOptions& options,
                    const RunContext& context);

}  // namespace stipple
