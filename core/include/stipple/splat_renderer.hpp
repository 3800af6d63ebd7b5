#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/splats.hpp"

#include <Eigen/Geometry>
#include <span>
#include <vector>

namespace stipple {

/// Pixels as shown: sRGB, straight alpha, row by row from the top left.
struct Image {
    unsigned width = 0, height = 0;
    std::vector<Rgba8> pixels;  ///< width * height

    const Rgba8& at(unsigned x, unsigned y) const { return pixels[std::size_t{y} * width + x]; }
};

/// The direction from which a cloud is viewed.
struct ViewOptions {
    Vec3d toward_eye{0.35, 0.25, 1.0};  ///< from the centre of the points; any length but 0
    Vec3d up = Vec3d::UnitY();          ///< points up in the picture; not along `toward_eye`
    double field_of_view_rad = 0.4;     ///< of the height, in [0, 2.5]; 0: orthographic
    double margin = 0.04;  ///< fraction of width and height left free on each side, in [0, 0.45]
};

/// A pinhole or orthographic camera. `right`, `up` and `forward` are orthogonal unit vectors;
/// positions are relative to the origin of the cloud.
struct Camera {
    Vec3d eye = Vec3d::Zero();
    Vec3d right = Vec3d::UnitX(), up = Vec3d::UnitY(), forward = -Vec3d::UnitZ();
    bool perspective = true;
    double half_height =
        1;  ///< of the picture: at depth 1 in perspective, otherwise in input units
};

/// Bounds of the projected points, to the right and up: on the plane at depth 1 in perspective,
/// otherwise in input units. O(N), on the threads of `context`.
Eigen::AlignedBox2d picture_bounds(std::span<const Vec3f> points, const Camera& camera,
                                   const RunContext& context = {});

/// The camera that shows all of N >= 1 points as large as possible. Clouds shown by the same camera
/// can be compared.
/// @param aspect  width over height of the picture, > 0.
/// @throws Error(InvalidArgument) for no points, or an invalid view; Cancelled.
///
/// O(N), on the threads of `context`.
Camera fit_camera(std::span<const Vec3f> points, const ViewOptions& view, double aspect,
                  const RunContext& context = {});

/// How discs become a surface.
enum class SplatStyle {
    Smooth,  ///< normals and colours of overlapping discs are blended (elliptical weighted average)
    Discs,   ///< every disc flat and with a rim, so that discs can be distinguished
};

struct SplatRenderOptions {
    unsigned width = 800, height = 800;  ///< pixels, 1..16384
    unsigned samples = 3;                ///< n * n samples per pixel, 1..8
    SplatStyle style = SplatStyle::Smooth;
    double radius_scale = 1;  ///< > 0: scales every disc
    bool cull_back_faces =
        false;  ///< whether discs that face away are omitted; otherwise both sides of a disc are
                ///< lit, and the sign of normals does not matter
    Rgba8 color{206, 188, 164, 255};       ///< of all splats, if no colours are given
    Rgba8 background{255, 255, 255, 255};  ///< alpha 0: none
    double relief = 1;       ///< strength of light and shade, in [0, 1]; 0: colours alone
    double occlusion = 0.8;  ///< how much creases and hollows are darkened, in [0, 1]
};

/// Draws N splats as a lit surface, without a display: a key light over the left shoulder of the
/// eye, light from the sky above and the ground below, less of it in hollows (ambient occlusion
/// from the depths of the picture). Rays are intersected with the discs themselves, so depth is
/// right within a disc; splats smaller than a sample are drawn at that size (Botsch et al. 2005),
/// so that dense clouds have no holes.
///
/// @param splats  N `radii` and N `normals`, or N `normals`, `major` and `minor` (ellipses).
/// @param colors  N, or none: `options.color`.
/// @throws Error(InvalidArgument) for an option out of range, or arrays of other lengths.
///
/// O(N + pixels * samples^2), parallel; 32 bytes per sample, about 20 per splat and 7 MB per
/// thread. The same bytes for any number of threads.
Image render_splats(std::span<const Vec3f> positions, const Splats& splats,
                    std::span<const Rgba8> colors, const Camera& camera,
                    const SplatRenderOptions& options = {}, const RunContext& context = {});

/// The colour of `t` in [0, 1] (clamped; NaN is 0) in viridis, which is perceptually uniform.
Rgba8 viridis(double t) noexcept;

}  // namespace stipple
