#include "laz_chunk.hpp"

#include "byte_writer.hpp"
#include "laz_coder.hpp"

#include <algorithm>
#include <span>
#include <utility>

// Follows the layered compression of LAS 1.4 by LASzip 3 (Isenburg), for points of a single return
// and of one flight: of the contexts that other points have, those are in use that these have.

namespace stipple {

namespace {

using Layer = std::vector<std::byte>;

struct PositionLayers {
    Layer xy, z;
};

PositionLayers encode_positions(const std::vector<LazPosition>& positions) {
    constexpr std::size_t kSingle = 1;  // the context of a pulse's only return
    // Where a width of 2 or 3 was needed the next coordinate mostly needs about that, and so on.
    const auto by_width = [](unsigned width, unsigned most) {
        return kSingle + (width < most ? width & ~1U : most);
    };
    constexpr unsigned kMostForY = 20, kMostForZ = 18;
    LazEncoder xy, z;
    LazSymbols changed(128);  // fields, of which none does
    LazIntegers x_steps(32, 2), y_steps(32, kMostForY + 2), heights(32, kMostForZ + 2);
    LazMedian x_step, y_step;
    for (std::size_t i = 1; i < positions.size(); ++i) {
        const LazPosition &p = positions[i], &before = positions[i - 1];
        const std::int32_t dx = p[0] - before[0], dy = p[1] - before[1];
        xy.symbol(changed, 0);
        x_steps.encode(xy, x_step.value(), dx, kSingle);
        y_steps.encode(xy, y_step.value(), dy, by_width(x_steps.width(), kMostForY));
        heights.encode(z, before[2], p[2],
                       by_width((x_steps.width() + y_steps.width()) / 2, kMostForZ));
        x_step.add(dx);
        y_step.add(dy);
    }
    return {std::move(xy).finish(), std::move(z).finish()};
}

/// A layer of a field that does not change has no bytes.
template <typename Value>
bool is_constant(const std::vector<Value>& values) {
    return std::ranges::all_of(values, [&](const Value& v) { return v == values.front(); });
}

Layer encode_intensities(const std::vector<std::uint16_t>& intensities) {
    if (is_constant(intensities)) return {};
    constexpr std::size_t kSingle = 3;
    LazEncoder layer;
    LazIntegers steps(16, 4);
    for (std::size_t i = 1; i < intensities.size(); ++i)
        steps.encode(layer, intensities[i - 1], intensities[i], kSingle);
    return std::move(layer).finish();
}

Layer encode_classifications(const std::vector<std::uint8_t>& classes) {
    if (is_constant(classes)) return {};
    constexpr unsigned kBefore = 32, kClasses = 256;
    LazEncoder layer;
    std::vector<LazSymbols> next(kBefore, LazSymbols(kClasses));
    for (std::size_t i = 1; i < classes.size(); ++i)
        layer.symbol(next[classes[i - 1] % kBefore], classes[i]);
    return std::move(layer).finish();
}

/// LAS wants 8 bits in the upper ones of its 16: the lower ones never change.
Layer encode_colors(const std::vector<Rgba8>& colors) {
    const auto same = [](const Rgba8& a, const Rgba8& b) {
        return a.r == b.r && a.g == b.g && a.b == b.b;
    };
    if (std::ranges::all_of(colors, [&](const Rgba8& c) { return same(c, colors.front()); }))
        return {};
    LazEncoder layer;
    LazSymbols changed(128);
    LazSymbols red(256), green(256), blue(256);
    const auto encode = [&](LazSymbols& model, int expected, int value) {
        layer.symbol(model, static_cast<std::uint8_t>(value - std::clamp(expected, 0, 255)));
    };
    for (std::size_t i = 1; i < colors.size(); ++i) {
        const Rgba8 &c = colors[i], &before = colors[i - 1];
        const bool is_gray = c.r == c.g && c.r == c.b;
        unsigned upper = 0;
        if (c.r != before.r) upper |= 1U << 1U;
        if (c.g != before.g) upper |= 1U << 3U;
        if (c.b != before.b) upper |= 1U << 5U;
        if (!is_gray) upper |= 1U << 6U;
        layer.symbol(changed, upper);
        const int step = c.r - before.r;
        if (c.r != before.r) encode(red, before.r, c.r);
        if (is_gray) continue;  // as the red
        if (c.g != before.g) encode(green, before.g + step, c.g);
        if (c.b != before.b) encode(blue, before.b + (step + c.g - before.g) / 2, c.b);
    }
    return std::move(layer).finish();
}

/// One byte of each point, after that of the point before.
Layer encode_bytes(std::span<const std::byte> bytes, std::size_t stride) {
    bool is_constant = true;
    LazEncoder layer;
    LazSymbols steps(256);
    for (std::size_t i = stride; i < bytes.size(); i += stride) {
        const auto step = static_cast<std::uint8_t>(std::to_integer<unsigned>(bytes[i]) -
                                                    std::to_integer<unsigned>(bytes[i - stride]));
        is_constant = is_constant && step == 0;
        layer.symbol(steps, step);
    }
    return is_constant ? Layer{} : std::move(layer).finish();
}

void put_first_point(ByteWriter& to, const LazPoints& points) {
    constexpr std::uint8_t kOnlyReturn = 0x11;  // the first of one
    for (const std::int32_t coordinate : points.positions.front()) to.put(coordinate);
    to.put<std::uint16_t>(points.intensities.empty() ? 0 : points.intensities.front());
    to.put<std::uint8_t>(kOnlyReturn);
    to.put<std::uint8_t>(0);  // flags
    to.put<std::uint8_t>(points.classifications.empty() ? 0 : points.classifications.front());
    to.put<std::uint8_t>(0);   // user data
    to.put<std::int16_t>(0);   // scan angle
    to.put<std::uint16_t>(0);  // point source
    to.put<double>(0);         // GPS time
    if (!points.colors.empty()) {
        const Rgba8& c = points.colors.front();
        for (const unsigned channel : {c.r, c.g, c.b})
            to.put(static_cast<std::uint16_t>(channel << 8U));
    }
    to.put(std::span(points.extras).first(points.extra_size));
}

}  // namespace

std::vector<std::byte> encode_laz_chunk(const LazPoints& points) {
    PositionLayers positions = encode_positions(points.positions);
    std::vector<Layer> layers;
    layers.push_back(std::move(positions.xy));
    layers.push_back(std::move(positions.z));
    layers.push_back(encode_classifications(points.classifications));
    layers.emplace_back();  // flags
    layers.push_back(encode_intensities(points.intensities));
    layers.resize(layers.size() + 4);  // scan angle, user data, point source, GPS time
    if (!points.colors.empty()) layers.push_back(encode_colors(points.colors));
    for (std::size_t b = 0; b < points.extra_size; ++b)
        layers.push_back(encode_bytes(std::span(points.extras).subspan(b), points.extra_size));

    ByteWriter chunk;
    put_first_point(chunk, points);
    chunk.put(static_cast<std::uint32_t>(points.positions.size()));
    for (const Layer& layer : layers) chunk.put(static_cast<std::uint32_t>(layer.size()));
    for (const Layer& layer : layers) chunk.put(layer);
    return std::move(chunk.bytes);
}

std::vector<std::byte> encode_laz_chunk_table(const std::vector<LazChunkSize>& chunks) {
    ByteWriter table;
    table.put<std::uint32_t>(0);  // version
    table.put(static_cast<std::uint32_t>(chunks.size()));
    LazEncoder encoder;
    LazIntegers sizes(32, 2);
    LazChunkSize before{};
    for (const LazChunkSize& chunk : chunks) {
        sizes.encode(encoder, static_cast<std::int32_t>(before.points),
                     static_cast<std::int32_t>(chunk.points), 0);
        sizes.encode(encoder, static_cast<std::int32_t>(before.bytes),
                     static_cast<std::int32_t>(chunk.bytes), 1);
        before = chunk;
    }
    table.put(std::move(encoder).finish());
    return std::move(table.bytes);
}

}  // namespace stipple
