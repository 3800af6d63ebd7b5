#include "pyramid/tile_streams.hpp"

#include "cloud/attribute_name.hpp"
#include "cloud/directions.hpp"
#include "cloud/float4.hpp"
#include "cloud/srgb.hpp"
#include "stipple/error.hpp"

#include <meshoptimizer.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <tuple>
#include <type_traits>
#include <variant>

namespace stipple {

namespace {

using Type = TileStream::Type;

unsigned size_of(Type type) noexcept {
    switch (type) {
        case Type::Int8:
        case Type::Uint8:
            return 1;
        case Type::Int16:
        case Type::Uint16:
            return 2;
        case Type::Float:
            break;
    }
    return 4;
}

/// @param value  value(i, component), in the type of the stream.
template <typename T, typename Value>
TileStream make_stream(std::string name, Type type, unsigned components, std::size_t count,
                       VertexEncoder& encoder, Value&& value) {
    TileStream stream{.name = std::move(name), .type = type, .components = components};
    stream.stride = (components * static_cast<unsigned>(sizeof(T)) + 3) / 4 * 4;
    stream.bytes = encoder.encode(
        count, stream.stride, [&](std::size_t begin, std::size_t end, std::byte* vertices) {
            std::memset(vertices, 0, (end - begin) * stream.stride);
            for (std::size_t i = begin; i < end; ++i, vertices += stream.stride) {
                for (unsigned c = 0; c < components; ++c) {
                    const T v = value(i, c);
                    std::memcpy(vertices + c * sizeof(T), &v, sizeof(T));
                }
            }
        });
    return stream;
}

TileStream position_stream(std::span<const GridPoint> points, VertexEncoder& encoder) {
    TileStream stream{.name = "POSITION", .type = Type::Uint16, .components = 3, .stride = 8};
    stream.bytes = encoder.encode(
        points.size(), stream.stride, [&](std::size_t begin, std::size_t end, std::byte* to) {
            for (const auto& [x, y, z] : points.subspan(begin, end - begin)) {
                const std::array<std::uint16_t, 4> vertex = {x, y, z, 0};
                std::memcpy(to, vertex.data(), sizeof vertex);
                to += sizeof vertex;
            }
        });
    return stream;
}

/// Calls visit(value) for some values, whose memory is asked for in advance.
template <typename T, typename Visit>
void for_each_of(std::span<const T> values, std::span<const Index> numbers, Visit&& visit) {
    constexpr std::size_t kAhead = 16;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        __builtin_prefetch(&values[numbers[std::min(i + kAhead, numbers.size() - 1)]]);
        visit(values[numbers[i]]);
    }
}

/// Vectors of a block of vertices, coordinate by coordinate, as the filter OCTAHEDRAL of
/// `EXT_meshopt_compression` has their directions in eight bits (those of no length: up). Not by
/// the library, which takes one after the other, of length one.
class OctahedralBlock {
public:
    void add(const Vec3f& v) noexcept {
        for (std::size_t axis = 0; axis < 3; ++axis)
            at_[axis][size_] = v[static_cast<Eigen::Index>(axis)];
        ++size_;
    }

    /// Takes them out, four bytes each.
    void write(std::byte* to) noexcept {
        std::array<std::int32_t, kRoom> vertices;
        for (std::size_t i = 0; i < size_; i += 4) {
            const Int4 four = octahedral(load(&at_[0][i]), load(&at_[1][i]), load(&at_[2][i]));
            std::memcpy(&vertices[i], &four, sizeof four);
        }
        std::memcpy(to, vertices.data(), 4 * size_);
        size_ = 0;
    }

private:
    static constexpr std::size_t kRoom = std::tuple_size_v<VertexEncoder::Column>;

    static Float4 magnitude(Float4 v) noexcept { return v < 0.0F ? -v : v; }

    /// The octahedron's lower half lies outside the square that the upper one fills.
    static Int4 octahedral(Float4 x, Float4 y, Float4 z) noexcept {
        constexpr float kMost = 127;
        const Float4 one = splat(1.0F), length = magnitude(x) + magnitude(y) + magnitude(z);
        const Int4 some = (length > 0.0F) & (length < std::numeric_limits<float>::infinity());
        const Float4 u = some ? x / length : Float4{}, v = some ? y / length : Float4{};
        const Int4 below = some & (z < 0.0F);
        const auto code = [&](Float4 inside, Float4 other) {
            const Float4 outside = one - magnitude(other);
            const Float4 at = kMost * (below ? (inside < 0.0F ? -outside : outside) : inside);
            const Float4 half = at < 0.0F ? splat(-0.5F) : splat(0.5F);
            return __builtin_convertvector(at + half, Int4) & 0xFF;
        };
        constexpr std::int32_t kThird = 127 << 16;  // the sum of all three where it is up
        return code(u, v) | code(v, u) << 8 | kThird;
    }

    std::array<std::array<float, kRoom>, 3> at_{};
    std::size_t size_ = 0;
};

TileStream normal_stream(std::span<const Vec3f> normals, std::span<const Index> members,
                         VertexEncoder& encoder) {
    TileStream stream{.name = "NORMAL",
                      .type = Type::Int8,
                      .components = 3,
                      .normalized = true,
                      .stride = 4,
                      .octahedral = true};
    OctahedralBlock block;
    stream.bytes = encoder.encode(members.size(), stream.stride,
                                  [&](std::size_t begin, std::size_t end, std::byte* to) {
                                      for_each_of(normals, members.subspan(begin, end - begin),
                                                  [&](const Vec3f& normal) { block.add(normal); });
                                      block.write(to);
                                  });
    return stream;
}

/// Linear light in 16 bits, as glTF has colours, for each code of sRGB: of the numbers that stand
/// for the code, one with as many low bits zero as there can be, which compresses best.
const std::array<std::uint16_t, 256>& linear_codes() {
    static const std::array<std::uint16_t, 256> codes = [] {
        std::array<std::uint16_t, 256> table{};
        constexpr double kMost = 65'535;
        for (std::size_t code = 0; code < table.size(); ++code) {
            const auto exact = static_cast<int>(
                std::lround(kMost * static_cast<double>(linear_from_srgb()[code])));
            table[code] = static_cast<std::uint16_t>(exact);
            for (int unit = 2; unit <= 256; unit *= 2) {
                const int round = (exact + unit / 2) / unit * unit;
                if (round > kMost || srgb_from_linear(round / kMost) != code) continue;
                table[code] = static_cast<std::uint16_t>(round);
            }
        }
        return table;
    }();
    return codes;
}

TileStream color_stream(std::span<const Rgba8> colors, std::span<const Index> members,
                        VertexEncoder& encoder) {
    TileStream stream{
        .name = "COLOR_0", .type = Type::Uint16, .components = 3, .normalized = true, .stride = 8};
    const std::array<std::uint16_t, 256>& codes = linear_codes();
    stream.bytes = encoder.encode(
        members.size(), stream.stride, [&](std::size_t begin, std::size_t end, std::byte* to) {
            for_each_of(colors, members.subspan(begin, end - begin), [&](const Rgba8& color) {
                const std::array<std::uint16_t, 4> vertex = {codes[color.r], codes[color.g],
                                                             codes[color.b], 0};
                std::memcpy(to, vertex.data(), sizeof vertex);
                to += sizeof vertex;
            });
        });
    return stream;
}

constexpr std::string_view kAlpha = "_COLOR_0_ALPHA";

/// Beside the colours, not in them: points are opaque, but there are viewers that darken colours by
/// their alpha all the same. Normalized, which no attribute is, and of a name that none has.
TileStream alpha_stream(const PointCloud& cloud, std::span<const Index> members,
                        VertexEncoder& encoder) {
    std::string name(kAlpha);
    while (find_attribute(cloud, name.substr(1)) != nullptr) name += '_';
    TileStream stream = make_stream<std::uint8_t>(
        std::move(name), Type::Uint8, 1, members.size(), encoder,
        [&](std::size_t i, unsigned) { return cloud.colors[members[i]].a; });
    stream.normalized = true;
    return stream;
}

/// What glTF has for a type of values.
template <typename T>
constexpr Type type_for() {
    if constexpr (std::is_same_v<T, std::int8_t>) return Type::Int8;
    if constexpr (std::is_same_v<T, std::uint8_t>) return Type::Uint8;
    if constexpr (std::is_same_v<T, std::int16_t>) return Type::Int16;
    if constexpr (std::is_same_v<T, std::uint16_t>) return Type::Uint16;
    return Type::Float;
}

template <typename T>
double float_offset(const std::vector<T>& values) {
    if constexpr (type_for<T>() != Type::Float || std::is_same_v<T, float>) {
        return 0;
    } else {
        constexpr double kFar = 4;  // two bits more
        double least = std::numeric_limits<double>::infinity(), most = -least;
        bool is_exact = true;
        for (const T v : values) {
            const auto value = static_cast<double>(v);
            if (!std::isfinite(value)) continue;
            least = std::min(least, value);
            most = std::max(most, value);
            is_exact = is_exact && static_cast<double>(static_cast<float>(value)) == value;
        }
        const bool is_far = std::max(-least, most) > kFar * (most - least);
        return is_far && !is_exact ? std::floor(least) : 0;
    }
}

void add_attribute(const Attribute& attribute, std::span<const Index> members, double offset,
                   VertexEncoder& encoder, std::vector<TileStream>& streams) {
    const unsigned all = attribute.components, each = all <= 4 ? all : 1;
    std::visit(
        [&]<typename T>(const std::vector<T>& values) {
            constexpr Type type = type_for<T>();
            using Stored = std::conditional_t<type == Type::Float, float, T>;
            for (unsigned first = 0; first < all; first += each) {
                std::string name(1, '_');
                name += attribute.name;
                if (all > 4) name += '_' + std::to_string(first);
                while (std::ranges::find(streams, name, &TileStream::name) != streams.end())
                    name += '_';
                bool has_no_data = false;
                TileStream stream = make_stream<Stored>(
                    std::move(name), type, each, members.size(), encoder,
                    [&](std::size_t i, unsigned c) {
                        const T own = values[std::size_t{members[i]} * all + first + c];
                        const auto value = static_cast<Stored>(
                            type == Type::Float ? static_cast<double>(own) - offset : own);
                        if constexpr (type == Type::Float) {
                            if (!std::isfinite(value)) {
                                has_no_data = true;
                                return TileStream::kNoData;
                            }
                        }
                        return value;
                    });
                stream.has_no_data = has_no_data;
                stream.offset = offset;
                streams.push_back(std::move(stream));
            }
        },
        attribute.values);
}

std::vector<std::byte> decompress(const TileStream& stream, std::size_t count) {
    const unsigned least = stream.components * size_of(stream.type);
    if (stream.components < 1 || stream.components > 4 || stream.stride < least ||
        stream.stride % 4 != 0 || stream.stride > 256)
        throw Error(ErrorCode::MalformedInput,
                    stream.name + ": " + std::to_string(stream.components) + " components in " +
                        std::to_string(stream.stride) + " bytes: expected 1..4 in at most 256");
    constexpr std::size_t kMost = 64;  // times that the codec makes of them
    if (count > stream.bytes.size() * kMost / stream.stride)
        throw Error(ErrorCode::MalformedInput, stream.name + ": " + std::to_string(count) +
                                                   " points in " +
                                                   std::to_string(stream.bytes.size()) + " bytes");
    std::vector<std::byte> raw(count * stream.stride);
    const auto* const bytes = reinterpret_cast<const unsigned char*>(stream.bytes.data());
    if (meshopt_decodeVertexBuffer(raw.data(), count, stream.stride, bytes, stream.bytes.size()))
        throw Error(ErrorCode::MalformedInput, stream.name + ": its bytes cannot be decoded");
    if (stream.octahedral) meshopt_decodeFilterOct(raw.data(), count, stream.stride);
    return raw;
}

template <typename T>
T value_at(const std::vector<std::byte>& raw, const TileStream& stream, std::size_t i, unsigned c) {
    T value;
    std::memcpy(&value, raw.data() + i * stream.stride + c * sizeof(T), sizeof(T));
    return value;
}

template <typename T>
Attribute read_attribute(const TileStream& stream, const std::vector<std::byte>& raw,
                         std::size_t count) {
    std::vector<T> values;
    values.reserve(count * stream.components);
    for (std::size_t i = 0; i < count; ++i)
        for (unsigned c = 0; c < stream.components; ++c)
            values.push_back(value_at<T>(raw, stream, i, c));
    if constexpr (std::is_same_v<T, float>) {
        if (stream.has_no_data)
            std::ranges::replace(values, TileStream::kNoData, std::numeric_limits<T>::quiet_NaN());
    }
    Attribute attribute{stream.name.substr(1), std::move(values), stream.components};
    if constexpr (std::is_same_v<T, float>) {
        if (stream.offset != 0) {
            const auto& less = std::get<std::vector<float>>(attribute.values);
            std::vector<double> whole(less.begin(), less.end());
            for (double& value : whole) value += stream.offset;
            attribute.values = std::move(whole);
        }
    }
    attribute.reduction = reduction_of(attribute.name, attribute.values);
    return attribute;
}

Attribute read_attribute(const TileStream& stream, const std::vector<std::byte>& raw,
                         std::size_t count) {
    switch (stream.type) {
        case Type::Int8:
            return read_attribute<std::int8_t>(stream, raw, count);
        case Type::Uint8:
            return read_attribute<std::uint8_t>(stream, raw, count);
        case Type::Int16:
            return read_attribute<std::int16_t>(stream, raw, count);
        case Type::Uint16:
            return read_attribute<std::uint16_t>(stream, raw, count);
        case Type::Float:
            break;
    }
    return read_attribute<float>(stream, raw, count);
}

bool is_alpha(const TileStream& stream) noexcept {
    return stream.name.starts_with(kAlpha) && stream.normalized && stream.type == Type::Uint8 &&
           stream.components == 1;
}

/// Takes what a stream says into the cloud.
void read_stream(const TileStream& stream, const LodTile& tile, PointCloud& cloud) {
    const std::vector<std::byte> raw = decompress(stream, tile.points);
    const auto is = [&](const char* name, Type type, unsigned components) {
        return stream.name == name && stream.type == type && stream.components == components;
    };
    const bool is_color = is("COLOR_0", Type::Uint16, 3),
               has_alpha = is("COLOR_0", Type::Uint16, 4);  // as earlier versions wrote it
    if (is_color || has_alpha || is_alpha(stream)) cloud.colors.resize(tile.points);
    for (std::size_t i = 0; i < tile.points; ++i) {
        if (is("POSITION", Type::Uint16, 3)) {
            Vec3d q;
            for (unsigned c = 0; c < 3; ++c) q[c] = value_at<std::uint16_t>(raw, stream, i, c);
            cloud.positions.push_back((tile.offset + tile.step * q).cast<float>());
        } else if (is("NORMAL", Type::Int8, 3)) {
            Vec3f n;
            for (unsigned c = 0; c < 3; ++c) n[c] = value_at<std::int8_t>(raw, stream, i, c);
            cloud.normals.push_back(n.normalized());
        } else if (is_color || has_alpha) {
            const auto code = [&](unsigned c) {
                return srgb_from_linear(value_at<std::uint16_t>(raw, stream, i, c) / 65'535.0);
            };
            Rgba8& color = cloud.colors[i];
            color = {code(0), code(1), code(2), color.a};
            if (has_alpha)
                color.a =
                    static_cast<std::uint8_t>(value_at<std::uint16_t>(raw, stream, i, 3) / 257);
        } else if (is_alpha(stream)) {
            cloud.colors[i].a = value_at<std::uint8_t>(raw, stream, i, 0);
        }
    }
    if (has_alpha || is_alpha(stream)) {
        cloud.has_alpha = true;
    } else if (stream.name.starts_with('_')) {
        cloud.attributes.push_back(read_attribute(stream, raw, tile.points));
    }
}

}  // namespace

TileContents::TileContents(const PointCloud& source, bool attributes_)
    : normals(source.normals.empty() || have_directions(source.normals)), attributes(attributes_) {
    if (!attributes) return;
    for (const Attribute& attribute : source.attributes) {
        const double offset =
            std::visit([](const auto& values) { return float_offset(values); }, attribute.values);
        if (offset != 0) offsets.emplace(attribute.name, offset);
    }
}

std::vector<TileStream> encode_streams(const PointCloud& cloud, std::span<const Index> members,
                                       std::span<const GridPoint> points,
                                       const TileContents& contents, VertexEncoder& encoder) {
    std::vector<TileStream> streams;
    streams.push_back(position_stream(points, encoder));
    if (contents.normals && !cloud.normals.empty())
        streams.push_back(normal_stream(cloud.normals, members, encoder));
    if (!cloud.colors.empty()) {
        streams.push_back(color_stream(cloud.colors, members, encoder));
        if (cloud.has_alpha) streams.push_back(alpha_stream(cloud, members, encoder));
    }
    if (contents.attributes) {
        for (const Attribute& attribute : cloud.attributes) {
            const auto found = contents.offsets.find(attribute.name);
            const double offset = found == contents.offsets.end() ? 0 : found->second;
            add_attribute(attribute, members, offset, encoder, streams);
        }
    }
    return streams;
}

PointCloud decode_tile(const LodTile& tile, const Vec3d& center) {
    PointCloud cloud;
    cloud.origin = center;
    for (const TileStream& stream : tile.streams) read_stream(stream, tile, cloud);
    if (cloud.size() != tile.points)
        throw Error(ErrorCode::MalformedInput,
                    "a tile of " + std::to_string(tile.points) + " points without positions");
    return cloud;
}

}  // namespace stipple
