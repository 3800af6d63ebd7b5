#pragma once

#include "rendering/splat_canvas.hpp"
#include "stipple/run_context.hpp"
#include "stipple/splat_renderer.hpp"

namespace stipple {

/// The picture of what was drawn, lit as `render_splats` says: each pixel the average of its
/// samples, in linear light, over the background.
///
/// @param samples  of `raster`, `options.samples` to a pixel each way.
/// @param reach  how far apart things may be that darken each other, input units.
///
/// O(pixels * samples^2), on the threads of `context`.
Image shade(const Raster& raster, const Canvas& samples, const SplatRenderOptions& options,
            double reach, const RunContext& context);

}  // namespace stipple
