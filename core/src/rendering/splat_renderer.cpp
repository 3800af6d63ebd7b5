// Surface splatting on the processor: rays against discs and a screen-space low-pass filter as in
// Botsch, Hornung, Zwicker, Kobbelt, "High-Quality Surface Splatting on Today's GPUs" (2005), whose
// deferred shading it also follows: depths first, then the blend of what lies near the nearest,
// then light for each sample (`splat_light.hpp`).

#include "stipple/splat_renderer.hpp"

#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "cloud/float4.hpp"
#include "cloud/point_bounds.hpp"
#include "cloud/srgb.hpp"
#include "rendering/camera.hpp"
#include "rendering/splat_canvas.hpp"
#include "rendering/splat_light.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace stipple {

namespace {

constexpr std::size_t kBandRows = 32;              // of samples; a thread draws a band at a time
constexpr std::size_t kStep = 16'384;              // samples drawn between looks at the stop token
constexpr float kRimSq = 0.8F, kRimShade = 0.55F;  // of `SplatStyle::Discs`
constexpr double kLeastRadiusSq = 0.75;  // in samples: a disc smaller than this is drawn that large
constexpr std::size_t kKept = 65'536;    // discs of a band that are made once, not for each pass

/// A splat in the camera's axes, depth away from the eye.
struct Disc {
    Vec3d center, normal, major, minor;
};

/// The rows and columns of samples that a disc may touch.
struct Extent {
    int left = 0, right = -1, top = 0, bottom = -1;  // inclusive; empty when right < left
};

/// A value that is linear over the picture, counted in samples from some sample.
struct Linear {
    float at = 0, per_x = 0, per_y = 0;

    Linear() = default;
    Linear(double at_origin, const Vec3d& change)
        : at(static_cast<float>(at_origin)),
          per_x(static_cast<float>(change.x())),
          per_y(static_cast<float>(change.y())) {}
    float row(int y) const { return at + per_y * static_cast<float>(y); }
};

/// A disc as it is drawn. The ray through a sample meets its plane at u / w and v / w, of which the
/// squares are 1 on the rim, and at the depth d / w.
struct Drawn {
    Extent extent;
    int x, y;  // the sample from which others are counted
    Linear u, v, w, d;
    float center_x, center_y;  // from that sample
    float depth, nearest;      // of the centre, and no sample is nearer
    float slack;               // how far behind another disc it may still be seen
    Vec3f normal;
};

class Scene {
public:
    Scene(std::span<const Vec3f> positions, const Splats& splats, std::span<const Rgba8> colors,
          const Camera& camera, const SplatRenderOptions& options)
        : positions_(positions),
          splats_(splats),
          colors_(colors),
          camera_(camera),
          options_(options),
          raster_{.width = static_cast<int>(options.width * options.samples),
                  .height = static_cast<int>(options.height * options.samples),
                  .scale = 0.5 * options.height * options.samples / camera.half_height,
                  .perspective = camera.perspective} {}

    const Raster& raster() const { return raster_; }

    Disc disc(std::size_t i) const {
        const auto turned = [&](const Vec3f& v) {
            const Vec3d d = v.cast<double>();
            return Vec3d(d.dot(camera_.right), d.dot(camera_.up), d.dot(camera_.forward));
        };
        Disc disc;
        disc.center = seen(camera_, positions_[i].cast<double>());
        disc.normal = turned(splats_.normals[i]);
        if (splats_.major.empty()) {
            disc.major = splats_.radii[i] * disc.normal.unitOrthogonal();
            disc.minor = disc.normal.cross(disc.major);
        } else {
            disc.major = turned(splats_.major[i]);
            disc.minor = turned(splats_.minor[i]);
        }
        disc.major *= options_.radius_scale;
        disc.minor *= options_.radius_scale;
        return disc;
    }

    Vec3f albedo(std::size_t i) const {
        const Rgba8 c = colors_.empty() ? options_.color : colors_[i];
        const auto& linear = linear_from_srgb();
        return {linear[c.r], linear[c.g], linear[c.b]};
    }

    bool faces_away(const Disc& disc) const {
        const Vec3d toward = raster_.perspective ? disc.center : Vec3d(0, 0, 1);
        return disc.normal.dot(toward) > 0;
    }

    /// Empty for what is behind the eye, beside the picture or culled.
    Extent extent(std::size_t i) const {
        const Disc d = disc(i);
        const double reach = std::abs(d.major.z()) + std::abs(d.minor.z());
        if (raster_.perspective && d.center.z() <= 2 * reach) return {};
        if (!(d.major.squaredNorm() > 0 && d.minor.squaredNorm() > 0)) return {};
        if (options_.cull_back_faces && faces_away(d)) return {};
        const auto [left, right] = bounds(d, 0);
        const auto [low, high] = bounds(d, 1);
        const auto clamped = [](double v, int size) {
            return static_cast<int>(std::clamp(v, -1.0, static_cast<double>(size)));
        };
        const double x = 0.5 * raster_.width - 0.5, y = 0.5 * raster_.height - 0.5;
        const double low_pass = std::sqrt(kLeastRadiusSq);
        return {.left = std::max(0, clamped(std::floor(x + left - low_pass), raster_.width)),
                .right = std::min(raster_.width - 1,
                                  clamped(std::ceil(x + right + low_pass), raster_.width)),
                .top = std::max(0, clamped(std::floor(y - high - low_pass), raster_.height)),
                .bottom = std::min(raster_.height - 1,
                                   clamped(std::ceil(y - low + low_pass), raster_.height))};
    }

    /// The disc of splat i, which may touch the samples of `extent`.
    Drawn drawn(Index i, const Extent& extent) const {
        const Disc disc = this->disc(i);
        const Eigen::Vector2d center = raster_.project(disc.center);
        const auto within = [](double v, int low, int high) {
            return static_cast<int>(
                std::clamp(v, static_cast<double>(low), static_cast<double>(high)));
        };
        const int x = within(center.x(), extent.left, extent.right);
        const int y = within(center.y(), extent.top, extent.bottom);
        const Eigen::Vector2d ray = raster_.ray(x, y);
        const Vec3d right(1 / raster_.scale, 0, 0), down(0, -1 / raster_.scale, 0);
        const Vec3d &n = disc.normal, &c = disc.center;
        const double offset = n.dot(c);
        // u w and so on of a place on the picture plane, or of a change of it where h is 0.
        const auto along = [&](const Vec3d& axis, const Vec3d& p, double h) {
            if (raster_.perspective) {
                const Vec3d q(p.x(), p.y(), h);
                return (offset * axis.dot(q) - axis.dot(c) * n.dot(q)) / axis.squaredNorm();
            }
            const Eigen::Vector2d q = p.head<2>() - h * c.head<2>();
            return (n.z() * axis.head<2>().dot(q) - axis.z() * n.head<2>().dot(q)) /
                   axis.squaredNorm();
        };
        const auto width = [&](const Vec3d& p, double h) {
            return raster_.perspective ? n.dot(Vec3d(p.x(), p.y(), h)) : h * n.z();
        };
        const auto depth = [&](const Vec3d& p, double h) {
            return raster_.perspective ? h * offset : h * offset - n.head<2>().dot(p.head<2>());
        };
        const Vec3d place(ray.x(), ray.y(), 0);
        const auto linear = [&](auto&& value) {
            return Linear(value(place, 1.0), {value(right, 0.0), value(down, 0.0), 0});
        };
        constexpr double kRounding = 1e-5;
        const double reach = std::hypot(disc.major.z(), disc.minor.z());
        const bool is_smooth = options_.style == SplatStyle::Smooth;
        return {.extent = extent,
                .x = x,
                .y = y,
                .u = linear([&](const Vec3d& p, double h) { return along(disc.major, p, h); }),
                .v = linear([&](const Vec3d& p, double h) { return along(disc.minor, p, h); }),
                .w = linear(width),
                .d = linear(depth),
                .center_x = static_cast<float>(center.x() - x),
                .center_y = static_cast<float>(center.y() - y),
                .depth = static_cast<float>(c.z()),
                .nearest = static_cast<float>(c.z() - reach - kRounding * std::abs(c.z())),
                .slack = is_smooth
                             ? static_cast<float>(std::max(disc.major.norm(), disc.minor.norm()))
                             : 0.0F,
                .normal = n.cast<float>()};
    }

    /// Calls `visit(sample, depth, r_sq)` for the samples of rows `top..bottom` on the disc at
    /// which it is no more than `slack` behind what `depths` has; `r_sq` is 0 in its middle and 1
    /// on its rim.
    template <typename Visit>
    void scan(const Drawn& disc, const float* depths, float slack, int top, int bottom,
              Visit&& visit) const {
        const Extent& e = disc.extent;
        constexpr Float4 kSteps = {0, 1, 2, 3};
        constexpr auto kPerLeastSq = static_cast<float>(1 / kLeastRadiusSq);
        for (int y = std::max(e.top, top); y <= std::min(e.bottom, bottom); ++y) {
            const int down = y - disc.y;
            const float u0 = disc.u.row(down), v0 = disc.v.row(down), w0 = disc.w.row(down),
                        d0 = disc.d.row(down);
            const float off_y = static_cast<float>(down) - disc.center_y;
            for (int x = e.left; x <= e.right; x += 4) {
                const std::size_t at = raster_.index(x, y);
                const Float4 seen = load(depths + at);
                if (lane_bits(disc.nearest <= seen + slack) == 0) continue;
                const Float4 right = kSteps + static_cast<float>(x - disc.x);
                const Float4 u = u0 + disc.u.per_x * right, v = v0 + disc.v.per_x * right,
                             w = w0 + disc.w.per_x * right, off_x = right - disc.center_x;
                const Float4 rim = u * u + v * v, one = w * w;
                const Float4 low_pass = (off_x * off_x + off_y * off_y) * kPerLeastSq;
                const Int4 within = kSteps <= static_cast<float>(e.right - x);
                const Int4 on_disc = (rim <= one) & (one > 0.0F), on_sample = low_pass <= 1.0F;
                unsigned lanes = lane_bits((on_disc | on_sample) & within);
                if (lanes == 0) continue;
                const Float4 depth =
                    on_disc ? (d0 + disc.d.per_x * right) / w : disc.depth + Float4{};
                const Float4 r_sq = on_disc ? rim / one : low_pass;
                lanes &= lane_bits(depth <= seen + slack);
                for (; lanes != 0; lanes &= lanes - 1) {
                    const int lane = std::countr_zero(lanes);
                    visit(at + static_cast<std::size_t>(lane), depth[lane], r_sq[lane]);
                }
            }
        }
    }

private:
    /// From where to where a disc is seen along an axis of the picture, in samples from its middle.
    std::pair<double, double> bounds(const Disc& disc, Eigen::Index axis) const {
        const double c = disc.center[axis], a = disc.major[axis], b = disc.minor[axis];
        if (!raster_.perspective) {
            const double reach = std::hypot(a, b);
            return {raster_.scale * (c - reach), raster_.scale * (c + reach)};
        }
        // Where the square (a - t a')^2 + (b - t b')^2 is (c - t c')^2, with ' for depths.
        const double az = disc.major.z(), bz = disc.minor.z(), cz = disc.center.z();
        const double square = cz * cz - az * az - bz * bz, half = c * cz - a * az - b * bz;
        const double root =
            std::sqrt(std::max(0.0, half * half - square * (c * c - a * a - b * b)));
        return {raster_.scale * (half - root) / square, raster_.scale * (half + root) / square};
    }

    std::span<const Vec3f> positions_;
    const Splats& splats_;
    std::span<const Rgba8> colors_;
    const Camera& camera_;
    const SplatRenderOptions& options_;
    Raster raster_;
};

/// The splats that touch each band of rows, in their order.
struct Bands {
    std::vector<Extent> extents;
    std::vector<std::size_t> offsets;
    std::vector<Index> splats;
};

Bands sort_into_bands(const Scene& scene, std::size_t n, const RunContext& context) {
    Bands bands;
    bands.extents.resize(n);
    parallel_for_blocks(n, 8192, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) bands.extents[i] = scene.extent(i);
    });
    const std::size_t rows = static_cast<std::size_t>(scene.raster().height);
    bands.offsets.assign((rows + kBandRows - 1) / kBandRows + 1, 0);
    const auto for_each_band = [&](auto&& body) {
        for_blocks_in_order(n, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                const Extent& e = bands.extents[i];
                if (e.right < e.left || e.bottom < e.top) continue;
                for (auto b = static_cast<std::size_t>(e.top) / kBandRows;
                     b <= static_cast<std::size_t>(e.bottom) / kBandRows; ++b)
                    body(b, static_cast<Index>(i));
            }
        });
    };
    for_each_band([&](std::size_t b, Index) { ++bands.offsets[b + 1]; });
    for (std::size_t b = 1; b < bands.offsets.size(); ++b) bands.offsets[b] += bands.offsets[b - 1];
    bands.splats.resize(bands.offsets.back());
    auto next = bands.offsets;
    for_each_band([&](std::size_t b, Index i) { bands.splats[next[b]++] = i; });
    return bands;
}

/// Depths of a band first, then normals and colours of the discs at that depth or just behind it.
void draw_band(const Scene& scene, const SplatRenderOptions& options, const Bands& bands,
               std::size_t band, const RunContext& context, Canvas& samples) {
    const std::span<const Index> splats(bands.splats.data() + bands.offsets[band],
                                        bands.offsets[band + 1] - bands.offsets[band]);
    const Raster& raster = scene.raster();
    const auto top = static_cast<int>(band * kBandRows);
    const int bottom = std::min(top + static_cast<int>(kBandRows), raster.height) - 1;
    const bool smooth = options.style == SplatStyle::Smooth;

    for (int y = top; y <= bottom; ++y) {
        context.throw_if_stopped();
        samples.clear(raster.index(0, y), raster.index(0, y + 1));
    }

    std::vector<Drawn> kept;
    const bool keeps = splats.size() <= kKept;
    if (keeps) kept.reserve(splats.size());
    std::size_t looked = 0;
    const auto look_up = [&](const Extent& e) {
        const int rows = std::min(e.bottom, bottom) - std::max(e.top, top) + 1;
        looked += static_cast<std::size_t>(rows) * static_cast<std::size_t>(e.right - e.left + 1);
        if (looked < kStep) return;
        context.throw_if_stopped();
        looked = 0;
    };
    for (const Index i : splats) {
        look_up(bands.extents[i]);
        const Drawn disc = scene.drawn(i, bands.extents[i]);
        if (keeps) kept.push_back(disc);
        scene.scan(disc, samples.depth.get(), 0, top, bottom,
                   [&](std::size_t at, float depth, float) { samples.depth[at] = depth; });
    }
    Drawn made;
    for (std::size_t k = 0; k < splats.size(); ++k) {
        const Index i = splats[k];
        look_up(bands.extents[i]);
        const Drawn& disc = keeps ? kept[k] : (made = scene.drawn(i, bands.extents[i]));
        const Eigen::Vector4f albedo = scene.albedo(i).homogeneous();
        scene.scan(disc, samples.depth.get(), disc.slack, top, bottom,
                   [&](std::size_t at, float, float r_sq) {
                       if (smooth) {
                           const float weight = (1 - r_sq) * (1 - r_sq) + 1e-4F;
                           // Discs at a silhouette face the eye or not by chance: their normals
                           // agree with each other, not each with the eye.
                           const bool agrees = samples.normal[at].dot(disc.normal) >= 0;
                           samples.normal[at] += (agrees ? weight : -weight) * disc.normal;
                           samples.albedo[at] += weight * albedo;
                       } else {
                           samples.normal[at] = disc.normal;
                           samples.albedo[at] = albedo;
                           if (r_sq > kRimSq) samples.albedo[at].head<3>() *= kRimShade;
                       }
                   });
    }
}

Canvas draw(const Scene& scene, std::size_t n, const SplatRenderOptions& options,
            const RunContext& context) {
    const Bands bands = sort_into_bands(scene, n, context);
    Canvas samples(scene.raster());
    parallel_for_blocks(bands.offsets.size() - 1, 1, context, [&](std::size_t band, std::size_t) {
        draw_band(scene, options, bands, band, context, samples);
    });
    return samples;
}

void check(std::size_t n, const Splats& splats, std::span<const Rgba8> colors,
           const SplatRenderOptions& options) {
    const auto in = [](unsigned value, unsigned limit) { return value >= 1 && value <= limit; };
    require(in(options.width, 16384), "width", options.width, "1..16384");
    require(in(options.height, 16384), "height", options.height, "1..16384");
    require(in(options.samples, 8), "samples", options.samples, "1..8");
    require(options.radius_scale > 0 && std::isfinite(options.radius_scale), "radius_scale",
            options.radius_scale, "more than 0");
    require(options.relief >= 0 && options.relief <= 1, "relief", options.relief, "0..1");
    require(options.occlusion >= 0 && options.occlusion <= 1, "occlusion", options.occlusion,
            "0..1");
    const auto sized = [&](std::size_t size, const char* name, bool may_be_absent) {
        if (size != n && !(may_be_absent && size == 0))
            refuse(name, ": ", size, " for ", n, " points");
    };
    sized(splats.normals.size(), "normals", false);
    sized(splats.major.size(), "major", true);
    sized(splats.minor.size(), "minor", splats.major.empty());
    sized(splats.radii.size(), "radii", !splats.major.empty());
    sized(colors.size(), "colors", true);
}

}  // namespace

Image render_splats(std::span<const Vec3f> positions, const Splats& splats,
                    std::span<const Rgba8> colors, const Camera& camera,
                    const SplatRenderOptions& options, const RunContext& context) {
    check(positions.size(), splats, colors, options);
    const Scene scene(positions, splats, colors, camera, options);
    const Canvas samples = draw(scene, positions.size(), options, context);
    context.checkpoint(0.6);
    const auto box = bounds_of(positions, context, [](const Vec3f& p) { return p; });
    const double reach = positions.empty() ? 1 : 0.06 * box.diagonal().norm();
    Image image = shade(scene.raster(), samples, options, reach, context);
    context.checkpoint(1);
    return image;
}

}  // namespace stipple
