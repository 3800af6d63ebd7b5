// Surface splatting on the processor: rays against discs and a screen-space low-pass filter as in
// Botsch, Hornung, Zwicker, Kobbelt, "High-Quality Surface Splatting on Today's GPUs" (2005), whose
// deferred shading it also follows: depths first, then the blend of what lies near the nearest,
// then light for each sample. Ambient occlusion as in McGuire et al., "The Alchemy Screen-Space
// Ambient Obscurance Algorithm" (2011).

#include "stipple/splat_renderer.hpp"

#include "parallel_for.hpp"
#include "srgb.hpp"
#include "stipple/error.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

namespace stipple {

namespace {

constexpr std::size_t kBandRows = 32;              // of samples; a thread draws a band at a time
constexpr std::size_t kBlock = 65'536;             // points of which a thread finds the bounds
constexpr std::size_t kStep = 16'384;              // samples drawn between looks at the stop token
constexpr float kRimSq = 0.8F, kRimShade = 0.55F;  // of `SplatStyle::Discs`
constexpr float kFar = std::numeric_limits<float>::infinity();
constexpr double kLeastRadiusSq = 0.75;  // in samples: a disc smaller than this is drawn that large

void require(bool fulfilled, const std::string& message) {
    if (!fulfilled) throw Error(ErrorCode::InvalidArgument, message);
}

// ------------------------------------------------------------------------------------- the camera

/// A point seen by a camera: to the right, up and away, in input units.
Vec3d seen(const Camera& camera, const Vec3d& p) {
    const Vec3d d = p - camera.eye;
    return {d.dot(camera.right), d.dot(camera.up), d.dot(camera.forward)};
}

Camera axes(const ViewOptions& view) {
    Camera camera;
    camera.forward = -view.toward_eye.normalized();
    camera.right = camera.forward.cross(view.up).normalized();
    camera.up = camera.right.cross(camera.forward);
    camera.perspective = view.field_of_view_rad > 0;
    return camera;
}

void check(const ViewOptions& view) {
    const double cross = view.toward_eye.cross(view.up).norm();
    require(cross > 1e-6 * view.toward_eye.norm() * view.up.norm(),
            "up: expected a direction other than toward_eye, and neither 0");
    require(view.field_of_view_rad >= 0 && view.field_of_view_rad <= 2.5,
            "field_of_view_rad " + std::to_string(view.field_of_view_rad) + ": expected 0..2.5");
    require(view.margin >= 0 && view.margin <= 0.45,
            "margin " + std::to_string(view.margin) + ": expected 0..0.45");
}

/// The box around what `place` makes of each point.
template <typename Place>
auto bounds_of(std::span<const Vec3f> points, const RunContext& context, Place&& place) {
    using Placed = decltype(place(points.front()));
    using Box = Eigen::AlignedBox<typename Placed::Scalar, Placed::RowsAtCompileTime>;
    std::vector<Box> boxes((points.size() + kBlock - 1) / kBlock);
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        Box& box = boxes[begin / kBlock];
        for (std::size_t i = begin; i < end; ++i) box.extend(place(points[i]));
    });
    Box all;
    for (const Box& box : boxes) all.extend(box);
    return all;
}

// -------------------------------------------------------------------------------------- the discs

/// A splat in the camera's axes, depth away from the eye.
struct Disc {
    Vec3d center, normal, major, minor;
};

/// The rows and columns of samples that a disc may touch.
struct Extent {
    int left = 0, right = -1, top = 0, bottom = -1;  // inclusive; empty when right < left
};

/// The samples of a picture and the rays through them.
struct Raster {
    int width, height;  // samples
    double scale;       // samples to the unit of the picture plane
    bool perspective;

    Eigen::Vector2d ray(int x, int y) const {
        return {(x + 0.5 - 0.5 * width) / scale, (0.5 * height - y - 0.5) / scale};
    }
    /// Where a point in the camera's axes is seen, in samples.
    Eigen::Vector2d project(const Vec3d& p) const {
        const double s = perspective ? scale / p.z() : scale;
        return {p.x() * s + 0.5 * width - 0.5, 0.5 * height - p.y() * s - 0.5};
    }
};

/// What is known of each sample of the picture.
struct Samples {
    std::vector<float> depth;             // kFar where nothing is
    std::vector<Vec3f> normal;            // in the camera's axes; of any length and sign
    std::vector<Eigen::Vector4f> albedo;  // linear, times the weight; the weight
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
        Eigen::AlignedBox2d box(raster_.project(d.center));
        for (const double a : {-1.0, 1.0})
            for (const double b : {-1.0, 1.0})
                box.extend(raster_.project(d.center + a * d.major + b * d.minor));
        const double low_pass = std::sqrt(kLeastRadiusSq);
        const auto clamped = [](double v, int size) {
            return static_cast<int>(std::clamp(v, -1.0, static_cast<double>(size)));
        };
        return {.left = std::max(0, clamped(std::floor(box.min().x() - low_pass), raster_.width)),
                .right = std::min(raster_.width - 1,
                                  clamped(std::ceil(box.max().x() + low_pass), raster_.width)),
                .top = std::max(0, clamped(std::floor(box.min().y() - low_pass), raster_.height)),
                .bottom = std::min(raster_.height - 1,
                                   clamped(std::ceil(box.max().y() + low_pass), raster_.height))};
    }

    /// Calls `visit(sample, depth, r_sq)` for the samples of rows `top..bottom` on the disc;
    /// `r_sq` is 0 in its middle and 1 on its rim.
    template <typename Visit>
    void scan(const Disc& disc, Extent e, int top, int bottom, Visit&& visit) const {
        const Eigen::Vector2d center = raster_.project(disc.center);
        const Vec3d u_axis = disc.major / disc.major.squaredNorm();
        const Vec3d v_axis = disc.minor / disc.minor.squaredNorm();
        const double offset = disc.normal.dot(disc.center);
        for (int y = std::max(e.top, top); y <= std::min(e.bottom, bottom); ++y) {
            for (int x = e.left; x <= e.right; ++x) {
                const Eigen::Vector2d ray = raster_.ray(x, y);
                Vec3d hit(ray.x(), ray.y(), 1.0);
                if (raster_.perspective)
                    hit *= offset / disc.normal.dot(hit);
                else
                    hit.z() = (offset - disc.normal.head<2>().dot(ray)) / disc.normal.z();
                const Vec3d d = hit - disc.center;
                const double u = u_axis.dot(d), v = v_axis.dot(d);
                double r_sq = u * u + v * v;
                double depth = hit.z();
                if (!(r_sq <= 1)) {  // nor is a ray along the disc
                    r_sq = (Eigen::Vector2d(x, y) - center).squaredNorm() / kLeastRadiusSq;
                    if (r_sq > 1) continue;
                    depth = disc.center.z();
                }
                visit(static_cast<std::size_t>(y) * static_cast<std::size_t>(raster_.width) +
                          static_cast<std::size_t>(x),
                      static_cast<float>(depth), static_cast<float>(r_sq));
            }
        }
    }

private:
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
               std::size_t band, const RunContext& context, Samples& samples) {
    const std::span<const Index> splats(bands.splats.data() + bands.offsets[band],
                                        bands.offsets[band + 1] - bands.offsets[band]);
    const auto top = static_cast<int>(band * kBandRows);
    const int bottom = top + static_cast<int>(kBandRows) - 1;
    const bool smooth = options.style == SplatStyle::Smooth;

    std::size_t drawn = 0;
    const auto for_each_disc = [&](auto&& body) {
        for (const Index i : splats) {
            const Extent& e = bands.extents[i];
            const int rows = std::min(e.bottom, bottom) - std::max(e.top, top) + 1;
            drawn +=
                static_cast<std::size_t>(rows) * static_cast<std::size_t>(e.right - e.left + 1);
            if (drawn >= kStep) {
                context.throw_if_stopped();
                drawn = 0;
            }
            body(i, scene.disc(i));
        }
    };
    for_each_disc([&](Index i, const Disc& disc) {
        scene.scan(disc, bands.extents[i], top, bottom, [&](std::size_t at, float depth, float) {
            samples.depth[at] = std::min(samples.depth[at], depth);
        });
    });
    for_each_disc([&](Index i, const Disc& disc) {
        const auto slack =
            smooth ? static_cast<float>(std::max(disc.major.norm(), disc.minor.norm())) : 0.0F;
        const Vec3f normal = disc.normal.cast<float>();
        const Eigen::Vector4f albedo = scene.albedo(i).homogeneous();
        scene.scan(disc, bands.extents[i], top, bottom,
                   [&](std::size_t at, float depth, float r_sq) {
                       if (depth > samples.depth[at] + slack) return;
                       if (smooth) {
                           const float weight = (1 - r_sq) * (1 - r_sq) + 1e-4F;
                           // Discs at a silhouette face the eye or not by chance: their normals
                           // agree with each other, not each with the eye.
                           const bool agrees = samples.normal[at].dot(normal) >= 0;
                           samples.normal[at] += (agrees ? weight : -weight) * normal;
                           samples.albedo[at] += weight * albedo;
                       } else {
                           samples.normal[at] = normal;
                           samples.albedo[at] = albedo;
                           if (r_sq > kRimSq) samples.albedo[at].head<3>() *= kRimShade;
                       }
                   });
    });
}

Samples draw(const Scene& scene, std::size_t n, const SplatRenderOptions& options,
             const RunContext& context) {
    const Bands bands = sort_into_bands(scene, n, context);
    const auto width = static_cast<std::size_t>(scene.raster().width);
    const std::size_t count = width * static_cast<std::size_t>(scene.raster().height);
    Samples samples{.depth = std::vector<float>(count, kFar),
                    .normal = std::vector<Vec3f>(count, Vec3f::Zero()),
                    .albedo = std::vector<Eigen::Vector4f>(count, Eigen::Vector4f::Zero())};
    parallel_for_blocks(bands.offsets.size() - 1, 1, context, [&](std::size_t band, std::size_t) {
        draw_band(scene, options, bands, band, context, samples);
    });
    return samples;
}

// -------------------------------------------------------------------------------------- the light

/// Lights what was drawn. Directions are the camera's: right, up, away.
class Light {
public:
    Light(const Raster& raster, const Samples& samples, const SplatRenderOptions& options,
          double reach)
        : raster_(raster), samples_(samples), options_(options), reach_(static_cast<float>(reach)) {
        // Places on a disc, in a spiral; each sample of a pixel turns it by another angle.
        for (unsigned i = 0; i < kTaps; ++i) {
            const double r = (i + 0.5) / kTaps, angle = 2.4 * std::numbers::pi * 2 * (i + 0.5);
            taps_[i] = Vec2f(static_cast<float>(r * std::cos(angle)),
                             static_cast<float>(r * std::sin(angle)));
        }
        for (unsigned i = 0; i < options.samples * options.samples; ++i) {
            const double angle = 2 * std::numbers::pi * i / (options.samples * options.samples);
            turns_.push_back(
                Vec2f(static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))));
        }
    }

    /// Linear colour of a sample that shows something.
    Vec3f at(int x, int y) const {
        const std::size_t i = index(x, y);
        const Vec3f n = outward_normal(x, y);
        const float open = options_.occlusion > 0 ? openness(x, y, n) : 1.0F;
        const Vec3f toward_eye(0, 0, -1);
        const float key = std::max(0.0F, n.dot(kKey));
        const float sky = 0.5F + 0.5F * n.y();
        const float fill = std::max(0.0F, n.dot(kFill));
        const float shine = power(std::max(0.0F, n.dot((kKey + toward_eye).normalized())), 5);
        const Vec3f light =
            (0.25F + 0.75F * open) * key * Vec3f(0.98F, 0.94F, 0.88F) +
            open * (sky * Vec3f(0.26F, 0.29F, 0.34F) + (1 - sky) * Vec3f(0.12F, 0.11F, 0.10F) +
                    fill * Vec3f(0.10F, 0.12F, 0.15F));
        const Vec3f albedo = samples_.albedo[i].hnormalized();
        const auto relief = static_cast<float>(options_.relief);
        return (1 - relief) * albedo +
               relief * (albedo.cwiseProduct(light) + Vec3f::Constant(0.05F * open * shine));
    }

private:
    using Vec2f = Eigen::Vector2f;
    static constexpr unsigned kTaps = 14;
    static inline const Vec3f kKey = Vec3f(-0.50F, 0.62F, -0.60F).normalized();
    static inline const Vec3f kFill = Vec3f(0.90F, 0.05F, -0.40F).normalized();

    static float power(float v, unsigned squarings) {
        for (unsigned i = 0; i < squarings; ++i) v *= v;
        return v;
    }
    std::size_t index(int x, int y) const {
        return static_cast<std::size_t>(y) * static_cast<std::size_t>(raster_.width) +
               static_cast<std::size_t>(x);
    }

    /// The normal of what is seen at a sample. That of a surface seen along it may as well be away
    /// from the eye, since discs reach beyond the silhouette: it agrees with those beside it.
    Vec3f outward_normal(int x, int y) const {
        constexpr float kAlong = 0.5F;
        const Vec3f n = samples_.normal[index(x, y)].normalized();
        const Vec3f ray = place(x, y, 1).normalized();
        Vec3f guide = -ray;
        if (float clearest = std::abs(n.dot(ray)); clearest < kAlong) {
            const float depth = samples_.depth[index(x, y)];
            const int step = 2 * static_cast<int>(options_.samples);
            for (int ty = y - step; ty <= y + step; ty += step)
                for (int tx = x - step; tx <= x + step; tx += step) {
                    if (tx < 0 || ty < 0 || tx >= raster_.width || ty >= raster_.height) continue;
                    const std::size_t t = index(tx, ty);
                    if (std::abs(samples_.depth[t] - depth) > 0.25F * reach_) continue;
                    const Vec3f beside = samples_.normal[t].normalized();
                    const float facing = beside.dot(ray);
                    if (std::abs(facing) <= clearest) continue;
                    clearest = std::abs(facing);
                    guide = facing > 0 ? Vec3f(-beside) : beside;
                }
        }
        return n.dot(guide) < 0 ? Vec3f(-n) : n;
    }

    Vec3f place(int x, int y, float depth) const {
        const Vec2f ray = raster_.ray(x, y).cast<float>();
        const float s = raster_.perspective ? depth : 1.0F;
        return {s * ray.x(), s * ray.y(), depth};
    }

    /// How much of the half space above a sample is free, of 1.
    float openness(int x, int y, const Vec3f& n) const {
        const float depth = samples_.depth[index(x, y)];
        const Vec3f p = place(x, y, depth);
        const float radius =
            reach_ * static_cast<float>(raster_.scale) / (raster_.perspective ? depth : 1.0F);
        const auto s = static_cast<int>(options_.samples);
        const Vec2f turn = turns_[static_cast<std::size_t>(y % s * s + x % s)];
        float closed = 0;
        for (const Vec2f& tap : taps_) {
            const float dx = radius * (tap.x() * turn.x() - tap.y() * turn.y());
            const float dy = radius * (tap.x() * turn.y() + tap.y() * turn.x());
            const int tx = x + static_cast<int>(dx), ty = y + static_cast<int>(dy);
            if (tx < 0 || ty < 0 || tx >= raster_.width || ty >= raster_.height) continue;
            const float other = samples_.depth[index(tx, ty)];
            if (other == kFar) continue;
            const Vec3f v = place(tx, ty, other) - p;
            const float distance_sq = v.squaredNorm();
            const float falloff = std::max(0.0F, 1 - distance_sq / (reach_ * reach_));
            const float above = n.dot(v) - 0.02F * reach_;
            if (above > 0) closed += falloff * above / std::sqrt(distance_sq + 1e-12F);
        }
        const auto strength = static_cast<float>(options_.occlusion);
        return std::max(0.0F, 1 - strength * 2.5F * closed / kTaps);
    }

    const Raster& raster_;
    const Samples& samples_;
    const SplatRenderOptions& options_;
    float reach_;  // of occlusion, input units
    std::array<Vec2f, kTaps> taps_;
    std::vector<Vec2f> turns_;
};

/// The average of a pixel's samples, in linear light, over the background.
Rgba8 pixel(const Light& light, const Samples& samples, const Raster& raster,
            const SplatRenderOptions& options, int px, int py) {
    const auto side = static_cast<int>(options.samples);
    const auto& linear = linear_from_srgb();
    const Rgba8& b = options.background;
    const Vec3f behind(linear[b.r], linear[b.g], linear[b.b]);
    const float behind_alpha = static_cast<float>(b.a) / 255.0F;
    Vec3f color = Vec3f::Zero();
    float alpha = 0;
    for (int y = py * side; y < (py + 1) * side; ++y)
        for (int x = px * side; x < (px + 1) * side; ++x) {
            const bool shown =
                samples.depth[static_cast<std::size_t>(y) * static_cast<std::size_t>(raster.width) +
                              static_cast<std::size_t>(x)] != kFar;
            const float a = shown ? 1.0F : behind_alpha;
            color += a * (shown ? light.at(x, y) : behind);
            alpha += a;
        }
    if (alpha == 0) return {0, 0, 0, 0};
    const auto code = [&](int channel) {
        return srgb_from_linear(std::min(1.0F, color[channel] / alpha));
    };
    return {
        code(0), code(1), code(2),
        static_cast<std::uint8_t>(std::lround(255.0F * alpha / static_cast<float>(side * side)))};
}

Image shade(const Raster& raster, const Samples& samples, const SplatRenderOptions& options,
            double reach, const RunContext& context) {
    const Light light(raster, samples, options, reach);
    Image image{.width = options.width, .height = options.height, .pixels = {}};
    image.pixels.resize(std::size_t{options.width} * options.height);
    parallel_for_blocks(options.height, 4, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t y = begin; y < end; ++y)
            for (std::size_t x = 0; x < options.width; ++x)
                image.pixels[y * options.width + x] = pixel(
                    light, samples, raster, options, static_cast<int>(x), static_cast<int>(y));
    });
    return image;
}

void check(std::size_t n, const Splats& splats, std::span<const Rgba8> colors,
           const SplatRenderOptions& options) {
    const auto in = [](unsigned value, unsigned limit) { return value >= 1 && value <= limit; };
    require(in(options.width, 16384),
            "width " + std::to_string(options.width) + ": expected 1..16384");
    require(in(options.height, 16384),
            "height " + std::to_string(options.height) + ": expected 1..16384");
    require(in(options.samples, 8),
            "samples " + std::to_string(options.samples) + ": expected 1..8");
    require(options.radius_scale > 0 && std::isfinite(options.radius_scale),
            "radius_scale " + std::to_string(options.radius_scale) + ": expected more than 0");
    require(options.relief >= 0 && options.relief <= 1,
            "relief " + std::to_string(options.relief) + ": expected 0..1");
    require(options.occlusion >= 0 && options.occlusion <= 1,
            "occlusion " + std::to_string(options.occlusion) + ": expected 0..1");
    const auto sized = [&](std::size_t size, const char* name, bool may_be_absent) {
        require(size == n || (may_be_absent && size == 0), std::string(name) + ": " +
                                                               std::to_string(size) + " for " +
                                                               std::to_string(n) + " points");
    };
    sized(splats.normals.size(), "normals", false);
    sized(splats.major.size(), "major", true);
    sized(splats.minor.size(), "minor", splats.major.empty());
    sized(splats.radii.size(), "radii", !splats.major.empty());
    sized(colors.size(), "colors", true);
}

}  // namespace

Eigen::AlignedBox2d picture_bounds(std::span<const Vec3f> points, const Camera& camera,
                                   const RunContext& context) {
    return bounds_of(points, context, [&](const Vec3f& p) -> Eigen::Vector2d {
        const Vec3d q = seen(camera, p.cast<double>());
        return q.head<2>() / (camera.perspective ? q.z() : 1.0);
    });
}

Camera fit_camera(std::span<const Vec3f> points, const ViewOptions& view, double aspect,
                  const RunContext& context) {
    require(!points.empty(), "points: none to look at");
    require(aspect > 0 && std::isfinite(aspect),
            "aspect " + std::to_string(aspect) + ": expected more than 0");
    check(view);
    Camera camera = axes(view);
    const auto box =
        bounds_of(points, context, [](const Vec3f& p) -> Vec3d { return p.cast<double>(); });
    const double size = std::max(box.diagonal().norm(), 1e-30);
    const double fill = 1 - 2 * view.margin;
    camera.half_height = camera.perspective ? std::tan(0.5 * view.field_of_view_rad) : 1;
    const double fov_scale = camera.perspective ? fill * camera.half_height : 1;
    camera.eye = box.center() - size / fov_scale * camera.forward;
    // Moves sideways until the picture is in the middle and, in perspective, along the axis until
    // it fills the frame: each step nearly undoes what the other left.
    for (int i = 0; i < 8; ++i) {
        const Eigen::AlignedBox2d picture = picture_bounds(points, camera, context);
        const double depth =
            camera.perspective ? (box.center() - camera.eye).dot(camera.forward) : 1;
        camera.eye +=
            depth * (picture.center().x() * camera.right + picture.center().y() * camera.up);
        if (!camera.perspective) continue;
        const auto spare = bounds_of(points, context, [&](const Vec3f& p) {
            const Vec3d q = seen(camera, p.cast<double>());
            const double need = std::max(std::abs(q.x()) / aspect, std::abs(q.y())) / fov_scale;
            return Eigen::Matrix<double, 1, 1>(q.z() - need);
        });
        camera.eye += spare.min().x() * camera.forward;
    }
    const Eigen::Vector2d half = 0.5 * picture_bounds(points, camera, context).sizes();
    if (!camera.perspective)
        camera.half_height = std::max({half.x() / aspect, half.y(), 1e-30}) / fill;
    return camera;
}

Image render_splats(std::span<const Vec3f> positions, const Splats& splats,
                    std::span<const Rgba8> colors, const Camera& camera,
                    const SplatRenderOptions& options, const RunContext& context) {
    check(positions.size(), splats, colors, options);
    const Scene scene(positions, splats, colors, camera, options);
    const Samples samples = draw(scene, positions.size(), options, context);
    context.checkpoint(0.6);
    const auto box = bounds_of(positions, context, [](const Vec3f& p) { return p; });
    const double reach = positions.empty() ? 1 : 0.06 * box.diagonal().norm();
    Image image = shade(scene.raster(), samples, options, reach, context);
    context.checkpoint(1);
    return image;
}

}  // namespace stipple
