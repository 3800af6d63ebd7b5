#include "progressive/progressive_values.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "cloud/attribute_name.hpp"
#include "cloud/whole_numbers.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <string>
#include <type_traits>

// Normals lie on an octahedron unfolded to a square (Meyer et al. 2010): whole numbers of which 0
// is a coordinate, so that the axes are exact. Colours are green and what red and blue are more.

namespace stipple {

namespace {

constexpr unsigned kWordBits = 32;

double sign_of(double value) noexcept {
    return value < 0 ? -1 : 1;
}

void fold(double& x, double& y) noexcept {
    const double u = x;
    x = (1 - std::abs(y)) * sign_of(u);
    y = (1 - std::abs(u)) * sign_of(y);
}

/// Of the grid of a coordinate, the number that stands for 0.
std::uint32_t normal_middle(unsigned bits) noexcept {
    return (1U << (bits - 1U)) - 1U;
}

void pack_normal(const Vec3f& normal, unsigned bits, std::uint32_t* values) {
    const std::uint32_t middle = normal_middle(bits);
    const Vec3d n = normal.cast<double>();
    const double sum = n.cwiseAbs().sum();
    if (!(sum > 0) || !std::isfinite(sum)) {
        values[0] = values[1] = 2 * middle + 1;  // no direction
        return;
    }
    double x = n.x() / sum, y = n.y() / sum;
    if (n.z() < 0) fold(x, y);
    values[0] = static_cast<std::uint32_t>(std::lround(x * middle) + middle);
    values[1] = static_cast<std::uint32_t>(std::lround(y * middle) + middle);
}

Vec3f unpack_normal(unsigned bits, const std::uint32_t* values) {
    const std::uint32_t middle = normal_middle(bits);
    if (values[0] > 2 * middle || values[1] > 2 * middle) return Vec3f::Zero();
    const auto m = static_cast<double>(middle);
    double x = (values[0] - m) / m, y = (values[1] - m) / m;
    const double z = 1 - std::abs(x) - std::abs(y);
    if (z < 0) fold(x, y);
    const double length = std::sqrt(x * x + y * y + z * z);
    return {static_cast<float>(x / length), static_cast<float>(y / length),
            static_cast<float>(z / length)};
}

void pack_color(const Rgba8& color, std::uint32_t* values) {
    values[0] = color.g;
    values[1] = static_cast<std::uint8_t>(color.r - color.g);
    values[2] = static_cast<std::uint8_t>(color.b - color.g);
}

Rgba8 unpack_color(const std::uint32_t* values, bool alpha) {
    const auto g = static_cast<std::uint8_t>(values[0]);
    return {static_cast<std::uint8_t>(values[1] + g), g, static_cast<std::uint8_t>(values[2] + g),
            static_cast<std::uint8_t>(alpha ? values[3] : 255U)};
}

template <typename T>
void pack_value(T value, const ProgressiveAttribute& attribute, std::uint32_t* values) {
    if constexpr (std::is_same_v<T, double>) {
        const auto raw = std::bit_cast<std::uint64_t>(value);
        values[0] = static_cast<std::uint32_t>(raw >> kWordBits);
        values[1] = static_cast<std::uint32_t>(raw);
    } else if constexpr (std::is_same_v<T, float>) {
        values[0] = attribute.bits == 0 ? std::bit_cast<std::uint32_t>(value)
                                        : static_cast<std::uint32_t>(std::llround(
                                              (double{value} - attribute.low) / attribute.step));
    } else {
        values[0] = std::make_unsigned_t<T>(value);
    }
}

template <typename T>
T unpack_value(const std::uint32_t* values, const ProgressiveAttribute& attribute) {
    if constexpr (std::is_same_v<T, double>) {
        return std::bit_cast<double>(std::uint64_t{values[0]} << kWordBits | values[1]);
    } else if constexpr (std::is_same_v<T, float>) {
        return attribute.bits == 0 ? std::bit_cast<float>(values[0])
                                   : static_cast<float>(attribute.low + attribute.step * values[0]);
    } else {
        return static_cast<T>(values[0]);
    }
}

template <std::size_t Type = 0>
AttributeValues values_of_type(std::size_t type) {
    if constexpr (Type + 1 < std::variant_size_v<AttributeValues>)
        if (type != Type) return values_of_type<Type + 1>(type);
    return AttributeValues(std::in_place_index<Type>);
}

}  // namespace

std::vector<ProgressiveAttribute> describe_attributes(const PointCloud& cloud, unsigned bits) {
    std::vector<ProgressiveAttribute> described;
    for (const Attribute& attribute : cloud.attributes) {
        if (!is_attribute_name(attribute.name) || attribute.components < 1 ||
            attribute.components > 255) {
            throw Error(ErrorCode::InvalidArgument,
                        "attribute " + attribute.name + " with " +
                            std::to_string(attribute.components) +
                            " components: expected 1..255 and a name of " +
                            std::string(kAttributeNameRule));
        }
        ProgressiveAttribute to{.name = attribute.name,
                                .type = static_cast<std::uint8_t>(attribute.values.index()),
                                .components = static_cast<std::uint8_t>(attribute.components),
                                .reduction = attribute.reduction};
        const auto* const floats = std::get_if<std::vector<float>>(&attribute.values);
        if (floats != nullptr && bits > 0 && !floats->empty() &&
            std::ranges::all_of(*floats, [](float v) { return std::isfinite(v); })) {
            const auto [least, most] = std::ranges::minmax(*floats);
            const double range = double{most} - double{least};
            const auto most_steps = static_cast<double>((std::uint64_t{1} << bits) - 1);
            const bool whole = are_whole(*floats);
            if (!whole || range <= most_steps) {
                to.bits = static_cast<std::uint8_t>(bits);
                to.low = least;
                if (range > 0) to.step = whole ? 1 : range / most_steps;
            }
        }
        described.push_back(std::move(to));
    }
    return described;
}

std::vector<std::uint32_t> pack_channels(const PointCloud& cloud, std::span<const Index> points,
                                         const ProgressiveLayout& layout,
                                         const RunContext& context) {
    const std::size_t count = layout.channels().size();
    auto values = made_in_blocks<std::vector<std::uint32_t>>(points.size() * count, context);
    std::size_t first = 0;
    const auto for_points = [&](unsigned channels, auto&& pack) {
        constexpr std::size_t kBlock = 8'192;
        parallel_for_blocks(points.size(), kBlock, context,
                            [&](std::size_t begin, std::size_t end) {
                                for (std::size_t i = begin; i < end; ++i)
                                    pack(points[i], &values[i * count + first]);
                            });
        first += channels;
    };
    if (layout.normals) {
        for_points(2, [&](Index p, std::uint32_t* to) {
            pack_normal(cloud.normals[p], layout.normal_bits, to);
        });
    }
    if (layout.colors)
        for_points(3, [&](Index p, std::uint32_t* to) { pack_color(cloud.colors[p], to); });
    if (layout.alpha) for_points(1, [&](Index p, std::uint32_t* to) { *to = cloud.colors[p].a; });
    for (std::size_t a = 0; a < layout.attributes.size(); ++a) {
        const ProgressiveAttribute& attribute = layout.attributes[a];
        const unsigned components = attribute.components, each = attribute.channels();
        std::visit(
            [&](const auto& from) {
                for_points(components * each, [&](Index p, std::uint32_t* to) {
                    for (unsigned c = 0; c < components; ++c)
                        pack_value(from[std::size_t{p} * components + c], attribute, to + c * each);
                });
            },
            cloud.attributes[a].values);
    }
    return values;
}

void unpack_channels(std::span<const std::uint32_t> values, const ProgressiveLayout& layout,
                     PointCloud& cloud, const RunContext& context) {
    const std::size_t count = layout.channels().size();
    const std::size_t n = count == 0 ? 0 : values.size() / count;
    std::size_t first = 0;
    const auto for_points = [&](auto&& unpack) {
        for_blocks_in_order(n, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) unpack(i, &values[i * count + first]);
        });
    };
    if (layout.normals) {
        resize_in_blocks(cloud.normals, n, context);
        for_points([&](std::size_t i, const std::uint32_t* from) {
            cloud.normals[i] = unpack_normal(layout.normal_bits, from);
        });
        first += 2;
    }
    if (layout.colors) {
        cloud.has_alpha = layout.alpha;
        resize_in_blocks(cloud.colors, n, context);
        for_points([&](std::size_t i, const std::uint32_t* from) {
            cloud.colors[i] = unpack_color(from, layout.alpha);
        });
        first += layout.alpha ? 4 : 3;
    }
    for (const ProgressiveAttribute& attribute : layout.attributes) {
        Attribute made{attribute.name, values_of_type(attribute.type), attribute.components,
                       attribute.reduction};
        const unsigned components = attribute.components, each = attribute.channels();
        std::visit(
            [&]<typename T>(std::vector<T>& to) {
                resize_in_blocks(to, n * components, context);
                for_points([&](std::size_t i, const std::uint32_t* from) {
                    for (unsigned c = 0; c < components; ++c)
                        to[i * components + c] = unpack_value<T>(from + c * each, attribute);
                });
            },
            made.values);
        cloud.attributes.push_back(std::move(made));
        first += components * each;
    }
}

}  // namespace stipple
