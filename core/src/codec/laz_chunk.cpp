#include "codec/laz_chunk.hpp"

#include "base/byte_writer.hpp"
#include "codec/laz_coder.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <span>
#include <utility>

// Follows the layered compression of LAS 1.4 by LASzip 3 (Isenburg), for points of one scanner
// channel: of the contexts that others have, those are in use that these have.

namespace stipple {

namespace {

using Layer = std::vector<std::byte>;

/// What the contexts of a point's fields depend on.
struct Pulse {
    LazReturn at;
    bool is_next = false;      ///< whether its time is not that of the point before
    bool is_of_other = false;  ///< whether its source is not

    unsigned is_only() const noexcept { return at.count == 1 ? 1 : 0; }
    /// Of its pulse: 0 in between, 1 the last, 2 the first, 3 the only one.
    unsigned place() const noexcept {
        return (at.number == 1 ? 2U : 0U) + (at.number == at.count ? 1U : 0U);
    }
    /// By how many returns there are, and which of them it is: one of six, twice.
    std::size_t kind() const noexcept {
        const unsigned n = at.count, r = at.number;
        unsigned kind = 4;  // in between
        if (n <= 2)
            kind = n == 1 ? 0 : r;
        else if (r == 1 || (r == 2 && n > 10))
            kind = 3;
        else if (r > 2 && (r == n || (r + 1 == n && n > 11)))
            kind = 5;
        return 2 * kind + (is_next ? 1 : 0);
    }
    /// How many returns come after it, at most seven.
    std::size_t level() const noexcept { return std::min(7, at.count - at.number); }
    /// How it is not as the point before: what a symbol tells.
    unsigned change_from(const Pulse& before) const noexcept {
        const unsigned step = (at.number - before.at.number) & 15U;
        const unsigned number = step == 0 ? 0 : step == 1 ? 1 : step == 15 ? 2 : 3;
        return number | (at.count != before.at.count ? 4U : 0U) | (is_next ? 16U : 0U) |
               (is_of_other ? 32U : 0U);
    }
};

std::vector<Pulse> pulses_of(const LazPoints& points) {
    std::vector<Pulse> pulses(points.positions.size());
    for (std::size_t i = 0; i < pulses.size(); ++i) {
        if (!points.returns.empty()) pulses[i].at = points.returns[i];
        if (i == 0) continue;
        const auto& t = points.times;
        pulses[i].is_next = !t.empty() && std::bit_cast<std::uint64_t>(t[i]) !=
                                              std::bit_cast<std::uint64_t>(t[i - 1]);
        pulses[i].is_of_other =
            !points.sources.empty() && points.sources[i] != points.sources[i - 1];
    }
    return pulses;
}

/// Which return each point is, among the steps of the positions.
class ReturnLayer {
public:
    void encode(LazEncoder& to, const Pulse& before, const Pulse& pulse) {
        const unsigned change = pulse.change_from(before);
        const unsigned context = (before.at.number == 1 ? 1U : 0U) +
                                 (before.at.number == before.at.count ? 2U : 0U) +
                                 (before.is_next ? 4U : 0U);
        to.symbol(changes_[context], change);
        if ((change & 4U) != 0) to.symbol(counts_[before.at.count], pulse.at.count);
        if ((change & 3U) != 3) return;
        if (pulse.is_next)
            to.symbol(numbers_[before.at.number], pulse.at.number);
        else
            to.symbol(steps_, ((pulse.at.number - before.at.number) & 15U) - 2);
    }

private:
    std::vector<LazSymbols> changes_{8, LazSymbols(128)}, counts_{16, LazSymbols(16)},
        numbers_{16, LazSymbols(16)};
    LazSymbols steps_{13};
};

struct PositionLayers {
    Layer xy, z;
};

PositionLayers encode_positions(const LazPoints& points, const std::vector<Pulse>& pulses) {
    // Where a width of 2 or 3 was needed the next coordinate mostly needs about that, and so on.
    const auto by_width = [](unsigned width, unsigned most) {
        return width < most ? width & ~1U : most;
    };
    constexpr unsigned kMostForY = 20, kMostForZ = 18;
    LazEncoder xy, z;
    ReturnLayer returns;
    LazIntegers x_steps(32, 2), y_steps(32, kMostForY + 2), heights(32, kMostForZ + 2);
    std::array<LazMedian, 12> x_step, y_step;
    std::array<std::int32_t, 8> height{};
    height.fill(points.positions.front()[2]);
    for (std::size_t i = 1; i < points.positions.size(); ++i) {
        const LazPosition &p = points.positions[i], &before = points.positions[i - 1];
        const Pulse& pulse = pulses[i];
        const std::size_t kind = pulse.kind(), level = pulse.level();
        const std::int32_t dx = p[0] - before[0], dy = p[1] - before[1];
        returns.encode(xy, pulses[i - 1], pulse);
        x_steps.encode(xy, x_step[kind].value(), dx, pulse.is_only());
        y_steps.encode(xy, y_step[kind].value(), dy,
                       pulse.is_only() + by_width(x_steps.width(), kMostForY));
        heights.encode(
            z, height[level], p[2],
            pulse.is_only() + by_width((x_steps.width() + y_steps.width()) / 2, kMostForZ));
        x_step[kind].add(dx);
        y_step[kind].add(dy);
        height[level] = p[2];
    }
    return {std::move(xy).finish(), std::move(z).finish()};
}

/// A layer of a field that does not change has no bytes.
template <typename Value>
bool is_constant(const std::vector<Value>& values) {
    return std::ranges::all_of(values, [&](const Value& v) { return v == values.front(); });
}

Layer encode_intensities(const std::vector<std::uint16_t>& intensities,
                         const std::vector<Pulse>& pulses) {
    if (is_constant(intensities)) return {};
    LazEncoder layer;
    LazIntegers steps(16, 4);
    std::array<std::uint16_t, 8> before{};
    before.fill(intensities.front());
    for (std::size_t i = 1; i < intensities.size(); ++i) {
        const unsigned place = pulses[i].place();
        steps.encode(layer,
                     std::exchange(before[2 * place + (pulses[i].is_next ? 1 : 0)], intensities[i]),
                     intensities[i], place);
    }
    return std::move(layer).finish();
}

Layer encode_classifications(const std::vector<std::uint8_t>& classes,
                             const std::vector<Pulse>& pulses) {
    if (is_constant(classes)) return {};
    constexpr unsigned kBefore = 32, kClasses = 256;
    LazEncoder layer;
    std::vector<LazSymbols> next(2 * kBefore, LazSymbols(kClasses));
    for (std::size_t i = 1; i < classes.size(); ++i)
        layer.symbol(next[2 * (classes[i - 1] % kBefore) + pulses[i].is_only()], classes[i]);
    return std::move(layer).finish();
}

Layer encode_flags(const std::vector<std::uint8_t>& flags) {
    if (is_constant(flags)) return {};
    constexpr unsigned kFlags = 64;
    const auto without_channel = [](unsigned f) { return (f & 15U) | (f >> 6U) << 4U; };
    LazEncoder layer;
    std::vector<LazSymbols> next(kFlags, LazSymbols(kFlags));
    for (std::size_t i = 1; i < flags.size(); ++i)
        layer.symbol(next[without_channel(flags[i - 1])], without_channel(flags[i]));
    return std::move(layer).finish();
}

Layer encode_user_data(const std::vector<std::uint8_t>& data) {
    if (is_constant(data)) return {};
    LazEncoder layer;
    std::vector<LazSymbols> next(64, LazSymbols(256));
    for (std::size_t i = 1; i < data.size(); ++i) layer.symbol(next[data[i - 1] / 4], data[i]);
    return std::move(layer).finish();
}

Layer encode_sources(const std::vector<std::uint16_t>& sources) {
    if (is_constant(sources)) return {};
    LazEncoder layer;
    LazIntegers steps(16, 1);
    for (std::size_t i = 1; i < sources.size(); ++i)
        if (sources[i] != sources[i - 1]) steps.encode(layer, sources[i - 1], sources[i], 0);
    return std::move(layer).finish();
}

/// Times by their bits as integers, each after the last of one of four sequences, as of flights
/// that cross: what is near none of them starts one. Of the multiples of a sequence's step that
/// decoders know only 0 is in use: points do not come in the order in which they were measured.
class TimeLayer {
public:
    explicit TimeLayer(double first) { sequences_[0].last = std::bit_cast<std::int64_t>(first); }

    void encode(double time) {
        const auto value = std::bit_cast<std::int64_t>(time);
        for (std::size_t i = 0; i < sequences_.size(); ++i) {
            const std::size_t other = (at_ + i) % sequences_.size();
            if (!is_near(sequences_[other].last, value)) continue;
            if (i > 0) tell(kNew + static_cast<unsigned>(i));
            at_ = other;
            return encode_step(value);
        }
        tell(kNew);
        const auto high = [](std::int64_t v) { return static_cast<std::int32_t>(v >> 32U); };
        integers_.encode(layer_, high(sequences_[at_].last), high(value), kHigh);
        layer_.direct(static_cast<std::uint32_t>(value), 32);
        newest_ = (newest_ + 1) % sequences_.size();
        at_ = newest_;
        sequences_[at_] = {value, 0, 0};
    }
    Layer finish() && { return std::move(layer_).finish(); }

private:
    /// The last time, and by how much it was more than that before; how often the step was not that
    /// since.
    struct Sequence {
        std::int64_t last = 0;
        std::int32_t step = 0;
        int others = 0;
    };
    static constexpr unsigned kStep = 0, kNew = 1;  ///< and behind it the other three sequences
    static constexpr unsigned kMultiples = 511;     ///< stand before kNew where there is a step
    static constexpr std::size_t kFirstStep = 0, kOtherStep = 7, kHigh = 8;  ///< contexts

    static bool is_near(std::int64_t a, std::int64_t b) noexcept {
        const auto off = static_cast<std::int64_t>(static_cast<std::uint64_t>(b) -
                                                   static_cast<std::uint64_t>(a));
        return off == static_cast<std::int32_t>(off);
    }
    void tell(unsigned symbol) {
        if (sequences_[at_].step == 0)
            layer_.symbol(without_step_, symbol);
        else
            layer_.symbol(with_step_, symbol == kStep ? kStep : kMultiples + symbol - kNew);
    }
    void encode_step(std::int64_t value) {
        Sequence& s = sequences_[at_];
        const auto step = static_cast<std::int32_t>(value - s.last);
        tell(kStep);
        integers_.encode(layer_, 0, step, s.step == 0 ? kFirstStep : kOtherStep);
        constexpr int kMostOthers = 3;
        if (s.step == 0 || ++s.others > kMostOthers) s = {value, step, 0};
        s.last = value;
    }

    std::array<Sequence, 4> sequences_;
    std::size_t at_ = 0, newest_ = 0;
    LazEncoder layer_;
    LazSymbols without_step_{5}, with_step_{515};
    LazIntegers integers_{32, 9};
};

Layer encode_times(const std::vector<double>& times, const std::vector<Pulse>& pulses) {
    if (std::ranges::none_of(pulses, &Pulse::is_next)) return {};
    TimeLayer layer(times.front());
    for (std::size_t i = 1; i < times.size(); ++i)
        if (pulses[i].is_next) layer.encode(times[i]);
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
    const auto first = []<typename Value>(const std::vector<Value>& values) {
        return values.empty() ? Value{} : values.front();
    };
    const LazReturn of_pulse = first(points.returns);
    for (const std::int32_t coordinate : points.positions.front()) to.put(coordinate);
    to.put(first(points.intensities));
    to.put(static_cast<std::uint8_t>(of_pulse.number | of_pulse.count << 4U));
    to.put(first(points.flags));
    to.put(first(points.classifications));
    to.put(first(points.user_data));
    to.put<std::int16_t>(0);  // scan angle
    to.put(first(points.sources));
    to.put(first(points.times));
    if (!points.colors.empty()) {
        const Rgba8& c = points.colors.front();
        for (const unsigned channel : {c.r, c.g, c.b})
            to.put(static_cast<std::uint16_t>(channel << 8U));
    }
    to.put(std::span(points.extras).first(points.extra_size));
}

}  // namespace

std::vector<std::byte> encode_laz_chunk(const LazPoints& points) {
    const std::vector<Pulse> pulses = pulses_of(points);
    PositionLayers positions = encode_positions(points, pulses);
    std::vector<Layer> layers;
    layers.push_back(std::move(positions.xy));
    layers.push_back(std::move(positions.z));
    layers.push_back(encode_classifications(points.classifications, pulses));
    layers.push_back(encode_flags(points.flags));
    layers.push_back(encode_intensities(points.intensities, pulses));
    layers.emplace_back();  // scan angle
    layers.push_back(encode_user_data(points.user_data));
    layers.push_back(encode_sources(points.sources));
    layers.push_back(encode_times(points.times, pulses));
    if (!points.colors.empty()) layers.push_back(encode_colors(points.colors));
    for (std::size_t b = 0; b < points.extra_size; ++b)
        layers.push_back(encode_bytes(std::span(points.extras).subspan(b), points.extra_size));

    ByteWriter chunk;
    std::size_t size = kLazPointSize + kLazColorSize + points.extra_size + sizeof(std::uint32_t);
    for (const Layer& layer : layers) size += sizeof(std::uint32_t) + layer.size();
    chunk.bytes.reserve(size);
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
