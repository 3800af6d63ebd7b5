#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/simplify.hpp"

#include <cstdint>
#include <functional>
#include <span>

namespace stipple {

/// The clouds of many sizes by the method of `options`, from one run where the method can (all but
/// particles, which are simulated for each size). The target of the options is not read.
///
/// @param sizes  descending, each in 1..N - 1.
/// @param on_cloud  called for each size, in their order, on the calling thread.
/// @throws Error(InvalidArgument) for a method that is none of `kErrorBoundedMethods`.
void make_snapshots(const PointCloud& cloud, const SimplifyOptions& options,
                    std::span<const std::uint64_t> sizes,
                    const std::function<void(PointCloud&&)>& on_cloud, const RunContext& context);

}  // namespace stipple
