// The last pass of deferred shading: light for each sample of what was drawn. Ambient occlusion as
// in McGuire et al., "The Alchemy Screen-Space Ambient Obscurance Algorithm" (2011).

#include "rendering/splat_light.hpp"

#include "base/parallel_for.hpp"
#include "cloud/srgb.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

namespace stipple {

namespace {

/// Lights what was drawn. Directions are the camera's: right, up, away.
class Light {
public:
    Light(const Raster& raster, const Canvas& samples, const SplatRenderOptions& options,
          double reach)
        : raster_(raster),
          samples_(samples),
          options_(options),
          reach_(static_cast<float>(reach)),
          per_sample_(static_cast<float>(1 / raster.scale)),
          middle_(0.5F * static_cast<float>(raster.width) - 0.5F,
                  0.5F * static_cast<float>(raster.height) - 0.5F) {
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
        const float key = std::max(0.0F, n.dot(kKey));
        const float sky = 0.5F + 0.5F * n.y();
        const float fill = std::max(0.0F, n.dot(kFill));
        const float shine = power(std::max(0.0F, n.dot(kShine)), 5);
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
    static inline const Vec3f kShine = (kKey + Vec3f(0, 0, -1)).normalized();  // toward the eye
    static inline const Vec3f kFill = Vec3f(0.90F, 0.05F, -0.40F).normalized();

    static float power(float v, unsigned squarings) {
        for (unsigned i = 0; i < squarings; ++i) v *= v;
        return v;
    }
    std::size_t index(int x, int y) const { return raster_.index(x, y); }

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
        const float s = raster_.perspective ? depth * per_sample_ : per_sample_;
        return {s * (static_cast<float>(x) - middle_.x()),
                s * (middle_.y() - static_cast<float>(y)), depth};
    }

    /// How much of the half space above a sample is free, of 1.
    float openness(int x, int y, const Vec3f& n) const {
        const float depth = samples_.depth[index(x, y)];
        const Vec3f p = place(x, y, depth);
        const float radius =
            reach_ * static_cast<float>(raster_.scale) / (raster_.perspective ? depth : 1.0F);
        const auto s = static_cast<int>(options_.samples);
        const Vec2f turn = turns_[static_cast<std::size_t>(y % s * s + x % s)];
        const float per_reach_sq = 1 / (reach_ * reach_);
        float closed = 0;
        for (const Vec2f& tap : taps_) {
            const float dx = radius * (tap.x() * turn.x() - tap.y() * turn.y());
            const float dy = radius * (tap.x() * turn.y() + tap.y() * turn.x());
            const int tx = x + static_cast<int>(dx), ty = y + static_cast<int>(dy);
            if (tx < 0 || ty < 0 || tx >= raster_.width || ty >= raster_.height) continue;
            const float other = samples_.depth[index(tx, ty)];
            if (other == Canvas::kFar) continue;
            const Vec3f v = place(tx, ty, other) - p;
            const float above = n.dot(v) - 0.02F * reach_;
            const float distance_sq = v.squaredNorm(), falloff = 1 - distance_sq * per_reach_sq;
            if (above > 0 && falloff > 0)
                closed += falloff * above / std::sqrt(distance_sq + 1e-12F);
        }
        const auto strength = static_cast<float>(options_.occlusion);
        return std::max(0.0F, 1 - strength * 2.5F * closed / kTaps);
    }

    const Raster& raster_;
    const Canvas& samples_;
    const SplatRenderOptions& options_;
    float reach_;       // of occlusion, input units
    float per_sample_;  // of the picture plane
    Vec2f middle_;      // of the picture, in samples
    std::array<Vec2f, kTaps> taps_;
    std::vector<Vec2f> turns_;
};

/// The average of a pixel's samples, in linear light, over the background.
Rgba8 pixel(const Light& light, const Canvas& samples, const Raster& raster,
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
            const bool shown = samples.depth[raster.index(x, y)] != Canvas::kFar;
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

}  // namespace

Image shade(const Raster& raster, const Canvas& samples, const SplatRenderOptions& options,
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

}  // namespace stipple
