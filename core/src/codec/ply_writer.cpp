// Writes PLY: one field a property, each with its source, then rows in blocks, in parallel.

#include "base/in_quotes.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "cloud/attribute_name.hpp"
#include "cloud/ply_names.hpp"
#include "codec/ply_header.hpp"
#include "stipple/codec.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstring>
#include <set>
#include <variant>

namespace stipple {

namespace {

// ---- Where the values of a property come from

struct AxisSource {
    const Vec3f* vectors;
    unsigned axis;
    float operator()(std::size_t row, unsigned) const noexcept { return vectors[row][axis]; }
};

struct CoordinateSource {
    const Vec3f* positions;
    unsigned axis;
    double origin;
    double operator()(std::size_t row, unsigned) const noexcept {
        return origin + static_cast<double>(positions[row][axis]);
    }
};

struct ChannelSource {
    const Rgba8* colors;
    std::uint8_t Rgba8::*channel;
    std::uint8_t operator()(std::size_t row, unsigned) const noexcept {
        return colors[row].*channel;
    }
};

template <typename T>
struct ValueSource {
    const T* values;
    unsigned components;
    T operator()(std::size_t row, unsigned component) const noexcept {
        return values[row * components + component];
    }
};

struct Field {
    std::string name;
    PlyType type;
    unsigned components;  ///< more than one: a list
    std::variant<AxisSource, CoordinateSource, ChannelSource, const AttributeValues*> source;
    std::size_t offset = 0;  ///< bytes from the start of a binary row

    bool is_list() const noexcept { return components != 1; }
    PlyType count_type() const noexcept {
        return components <= 255 ? PlyType::UInt8 : PlyType::Int32;
    }
    std::size_t bytes() const noexcept {
        return (is_list() ? size_of(count_type()) : 0) + components * size_of(type);
    }

    /// Calls `f` with a source whose values are of the type of the field.
    template <typename F>
    void with_source(F&& f) const {
        std::visit(
            [&]<typename S>(const S& s) {
                if constexpr (std::is_same_v<S, const AttributeValues*>) {
                    std::visit(
                        [&]<typename T>(const std::vector<T>& v) {
                            f(ValueSource<T>{v.data(), components});
                        },
                        *s);
                } else {
                    f(s);
                }
            },
            source);
    }
};

std::vector<Field> fields_of(const PointCloud& cloud) {
    constexpr std::array kChannels = {&Rgba8::r, &Rgba8::g, &Rgba8::b, &Rgba8::a};
    const bool wide = cloud.double_precision || !cloud.origin.isZero(0);

    std::vector<Field> fields;
    for (unsigned i = 0; i < 3; ++i) {
        if (wide) {
            fields.push_back({std::string(kPlyAxes[i]), PlyType::Float64, 1,
                              CoordinateSource{cloud.positions.data(), i, cloud.origin[i]}});
        } else {
            fields.push_back({std::string(kPlyAxes[i]), PlyType::Float32, 1,
                              AxisSource{cloud.positions.data(), i}});
        }
    }
    for (unsigned i = 0; i < 3 && !cloud.normals.empty(); ++i) {
        fields.push_back({std::string(kPlyNormals[i]), PlyType::Float32, 1,
                          AxisSource{cloud.normals.data(), i}});
    }
    for (unsigned i = 0; i < (cloud.has_alpha ? 4U : 3U) && !cloud.colors.empty(); ++i) {
        fields.push_back({std::string(kPlyColors[i]), PlyType::UInt8, 1,
                          ChannelSource{cloud.colors.data(), kChannels[i]}});
    }
    for (const Attribute& attribute : cloud.attributes) {
        fields.push_back({attribute.name, static_cast<PlyType>(attribute.values.index()),
                          attribute.components, &attribute.values});
    }
    std::size_t offset = 0;
    for (Field& field : fields) {
        field.offset = offset;
        offset += field.bytes();
    }
    return fields;
}

void check_names(std::span<const Field> fields) {
    std::set<std::string_view> seen;
    for (const Field& field : fields) {
        if (!is_attribute_name(field.name)) {
            refuse("attribute ", in_quotes(field.name), ": expected a name of ",
                   kAttributeNameRule);
        }
        if (!seen.insert(field.name).second) {
            refuse("attribute ", in_quotes(field.name),
                   ": a PLY file would have two properties of this name; rename it");
        }
        if (field.components == 0) {
            refuse("attribute ", in_quotes(field.name), " has 0 components: expected at least 1");
        }
    }
}

std::string header_of(const PointCloud& cloud, std::span<const Field> fields,
                      const PlyEncodeOptions& options) {
    std::string header = "ply\nformat " + std::string(name_of(options.encoding)) + " 1.0\n";
    for (const std::string& comment : options.comments) {
        if (comment.find_first_of("\r\n") != comment.npos) {
            refuse("comment ", in_quotes(comment), ": expected a single line");
        }
        header += "comment " + comment + "\n";
    }
    header += "element vertex " + std::to_string(cloud.size()) + "\n";
    for (const Field& field : fields) {
        header += "property ";
        if (field.is_list()) header += "list " + std::string(name_of(field.count_type())) + " ";
        header += std::string(name_of(field.type)) + " " + field.name + "\n";
    }
    return header + "end_header\n";
}

constexpr std::size_t kRowsPerBlock = 8192;

// ---- Binary rows

template <bool kSwap, typename T>
void store(std::byte* to, T value) noexcept {
    std::memcpy(to, &value, sizeof(T));
    if constexpr (kSwap && sizeof(T) > 1) std::reverse(to, to + sizeof(T));
}

template <bool kSwap>
void write_field(const Field& field, std::byte* rows, std::size_t stride, std::size_t begin,
                 std::size_t end) {
    field.with_source([&](const auto& source) {
        std::byte* at = rows + begin * stride + field.offset;
        for (std::size_t row = begin; row < end; ++row, at += stride) {
            std::byte* to = at;
            if (field.is_list()) {
                with_type(field.count_type(), [&]<typename T>() {
                    store<kSwap>(to, static_cast<T>(field.components));
                    to += sizeof(T);
                });
            }
            for (unsigned c = 0; c < field.components; ++c) {
                const auto value = source(row, c);
                store<kSwap>(to, value);
                to += sizeof(value);
            }
        }
    });
}

template <bool kSwap>
void write_rows(std::span<const Field> fields, std::size_t n, std::byte* rows,
                const RunContext& context) {
    const std::size_t stride = fields.back().offset + fields.back().bytes();
    parallel_for_blocks(n, kRowsPerBlock, context, [&](std::size_t begin, std::size_t end) {
        for (const Field& field : fields) write_field<kSwap>(field, rows, stride, begin, end);
    });
}

// ---- Text rows

template <typename T>
void append_number(std::string& text, T value) {
    std::array<char, 32> digits;
    // The shortest digits that give the same number back.
    const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), value);
    text.append(digits.data(), end);
}

std::string text_rows(std::span<const Field> fields, std::size_t begin, std::size_t end) {
    std::string text;
    for (std::size_t row = begin; row < end; ++row) {
        for (const Field& field : fields) {
            if (field.is_list()) {
                append_number(text, field.components);
                text += ' ';
            }
            field.with_source([&](const auto& source) {
                for (unsigned c = 0; c < field.components; ++c) {
                    append_number(text, source(row, c));
                    text += ' ';
                }
            });
        }
        text.back() = '\n';
    }
    return text;
}

void append(std::vector<std::byte>& bytes, std::string_view text) {
    const auto* const from = reinterpret_cast<const std::byte*>(text.data());
    bytes.insert(bytes.end(), from, from + text.size());
}

void append_text(std::vector<std::byte>& bytes, std::span<const Field> fields, std::size_t n,
                 const RunContext& context) {
    std::vector<std::string> blocks((n + kRowsPerBlock - 1) / kRowsPerBlock);
    parallel_for_blocks(n, kRowsPerBlock, context, [&](std::size_t begin, std::size_t end) {
        blocks[begin / kRowsPerBlock] = text_rows(fields, begin, end);
    });
    std::size_t size = bytes.size();
    for (const std::string& block : blocks) size += block.size();
    bytes.reserve(size);
    for (std::string& block : blocks) {
        context.throw_if_stopped();
        append(bytes, block);
        block = {};
    }
}

}  // namespace

std::vector<std::byte> encode_ply(const PointCloud& cloud, const PlyEncodeOptions& options,
                                  const RunContext& context) {
    validate(cloud);
    const std::vector<Field> fields = fields_of(cloud);
    check_names(fields);
    context.checkpoint(0);
    std::vector<std::byte> bytes;
    append(bytes, header_of(cloud, fields, options));
    if (options.encoding == PlyEncoding::Ascii) {
        append_text(bytes, fields, cloud.size(), context);
    } else {
        const std::size_t body = bytes.size();
        bytes.resize(body + cloud.size() * (fields.back().offset + fields.back().bytes()));
        const bool big = options.encoding == PlyEncoding::BinaryBigEndian;
        const bool swap = big != (std::endian::native == std::endian::big);
        const auto write = swap ? write_rows<true> : write_rows<false>;
        write(fields, cloud.size(), bytes.data() + body, context);
    }
    context.checkpoint(1);
    return bytes;
}

}  // namespace stipple
