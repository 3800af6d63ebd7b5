#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/splats.hpp"

#include <Eigen/Geometry>
#include <span>
#include <vector>

namespace stipple {

/// Pixels as they are shown: sRGB, straight alpha, row by row from the top left.
struct Image {
    unsigned width = 0, height = 0;
    std::vector<Rgba8> pixels;  ///< width * height

    const Rgba8& at(unsigned x, unsigned y) const { return pixels[std::size_t{y} * width + x]; }
};

/// From where a cloud is looked at.
struct ViewOptions {
    Vec3d toward_eye{0.35, 0.25, 1.0};  ///< from the middle of the points; any length but 0
    Vec3d up = Vec3d::UnitY();          ///< points up in the picture; not along `toward_eye`
    double field_of_view_rad = 0.4;     ///< of the height, in [0, 2.5]; 0: orthographic
    double margin = 0.04;  ///< of width and height, left free on each side, in [0, 0.45]
};

/// A pinhole, or an orthographic one. `right`, `up` and `forward` are unit and at right angles;
/// relative to the origin of the cloud.
struct Camera {
    Vec3d eye = Vec3d::Zero();
    Vec3d right = Vec3d::UnitX(), up = Vec3d::UnitY(), forward = -Vec3d::UnitZ();
    bool perspective = true;
    double half_height = 1;  ///< of the picture: at depth 1 in perspective, else in input units
};

/// Bounds of the picture of the points: to the right and up, on the plane at depth 1 in
/// perspective, else in input units. O(N), on the threads of `context`.
Eigen::AlignedBox2d picture_bounds(std::span<const Vec3f> points, const Camera& camera,
                                   const RunContext& context = {});

/// The camera in whose picture all of N >= 1 points are seen as large as they can be. Clouds shown
/// by the same camera can be compared. @param aspect  width over height of the picture, > 0.
///
/// @throws Error(InvalidArgument) for no points, or a view that is not one; Cancelled. O(N), on the
/// threads of `context`.
Camera fit_camera(std::span<const Vec3f> points, const ViewOptions& view, double aspect,
                  const RunContext& context = {});

/// How discs become a surface.
enum class SplatStyle {
    Smooth,  ///< normals and colours of overlapping discs are blended (elliptical weighted average)
    Discs,   ///< every disc flat and with a rim, so that it can be told from the next
};

struct SplatRenderOptions {
    unsigned width = 800, height = 800;  ///< pixels, 1..16384
    unsigned samples = 3;                ///< n * n samples a pixel, 1..8
    SplatStyle style = SplatStyle::Smooth;
    double radius_scale = 1;       ///< > 0: draws every disc so much larger
    bool cull_back_faces = false;  ///< whether discs that face away are left out; else both sides
                                   ///< of a disc are lit, and the sign of normals is all the same
    Rgba8 color{206, 188, 164, 255};       ///< of all, where no colours are given
    Rgba8 background{255, 255, 255, 255};  ///< alpha 0: none
    double relief = 1;       ///< how much light and shade there is, in [0, 1]; 0: colours alone
    double occlusion = 0.8;  ///< how much creases and hollows are darkened, in [0, 1]
};

/// Draws N splats as a lit surface, without a display: a key light over the left shoulder of the
/// eye, light from the sky above and the ground below, less of it in hollows (ambient occlusion
/// from the depths of the picture). Rays are met with the discs themselves, so depth is right
/// within a disc; splats smaller than a sample are drawn as one (Botsch et al. 2005), so that dense
/// clouds have no holes.
///
/// @param splats  N `radii` and N `normals`, or N `normals`, `major` and `minor` (ellipses).
/// @param colors  N, or none: `options.color`.
///
/// @throws Error(InvalidArgument) for an option out of range, or arrays of other lengths.
/// O(N + pixels * samples^2), parallel; 32 bytes a sample, about 20 a splat and 7 MB a thread. Any
/// number of threads gives the same bytes.
Image render_splats(std::span<const Vec3f> positions, const Splats& splats,
                    std::span<const Rgba8> colors, const Camera& camera,
                    const SplatRenderOptions& options = {}, const RunContext& context = {});

/// The colour of `t` in [0, 1] (clamped; NaN is 0) in viridis, whose lightness is even to the eye.
Rgba8 viridis(double t) noexcept;

}  // namespace stipple
