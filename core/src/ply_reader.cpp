// Reads PLY. The layout of a vertex is turned into one column a property, each with the place its
// values go to, before any value is read. Rows of fixed length are then decoded column by column
// over blocks of rows, and lines of text in blocks of lines, both in parallel; only vertices with
// lists, and text that is not one vertex a line, are read value after value.

#include "attribute_name.hpp"
#include "color_channel.hpp"
#include "georeference.hpp"
#include "in_quotes.hpp"
#include "parallel_for.hpp"
#include "ply.hpp"
#include "ply_cursor.hpp"
#include "ply_header.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <deque>
#include <exception>
#include <numeric>
#include <variant>

namespace stipple {

namespace {

// ---- What each property of a vertex means

struct Role {
    enum Kind { Position, Normal, Color, Attribute } kind = Attribute;
    unsigned component = 0;
};

constexpr std::array<std::string_view, 3> kPositionNames = {"x", "y", "z"};
constexpr std::array<std::array<std::string_view, 3>, 2> kNormalNames = {
    {{"nx", "ny", "nz"}, {"normal_x", "normal_y", "normal_z"}}};
constexpr std::array<std::array<std::string_view, 4>, 3> kColorNames = {
    {{"red", "green", "blue", "alpha"},
     {"r", "g", "b", "a"},
     {"diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"}}};

std::vector<Role> assign_roles(const PlyElement& vertex) {
    std::vector<Role> roles(vertex.properties.size());
    const auto index_of = [&](std::string_view name) -> std::optional<std::size_t> {
        const auto found = std::ranges::find_if(vertex.properties, [&](const PlyProperty& p) {
            return p.name == name && !p.is_list();
        });
        if (found == vertex.properties.end()) return std::nullopt;
        return static_cast<std::size_t>(found - vertex.properties.begin());
    };
    const auto assign = [&](std::span<const std::string_view> names, Role::Kind kind) {
        for (unsigned component = 0; component < names.size(); ++component) {
            if (const auto index = index_of(names[component])) roles[*index] = {kind, component};
        }
    };
    // Of several families of names the first that is whole counts; the others are attributes like
    // any.
    const auto assign_first_whole = [&](const auto& families, Role::Kind kind) {
        for (const auto& names : families) {
            if (std::all_of(names.begin(), names.begin() + 3,
                            [&](auto n) { return index_of(n).has_value(); })) {
                return assign(names, kind);
            }
        }
    };

    for (const std::string_view name : kPositionNames) {
        if (!index_of(name)) {
            throw Error(ErrorCode::MalformedInput,
                        "PLY header: element 'vertex' has no property '" + std::string(name) +
                            "': a point needs x, y and z");
        }
    }
    assign(kPositionNames, Role::Position);
    assign_first_whole(kNormalNames, Role::Normal);
    assign_first_whole(kColorNames, Role::Color);
    return roles;
}

/// What the header says of the points, and the file it is of.
struct Layout {
    std::span<const std::byte> file;
    PlyHeader header;
    const PlyElement* vertex = nullptr;
    std::vector<Role> roles;

    bool has(Role::Kind kind, unsigned component = 0) const {
        return std::ranges::any_of(
            roles, [&](const Role& r) { return r.kind == kind && r.component == component; });
    }
    /// Coordinates that a float does not hold, which are kept relative to an origin.
    bool wide_coordinates() const {
        for (std::size_t i = 0; i < roles.size(); ++i) {
            const PlyType type = vertex->properties[i].type;
            const bool wide =
                type == PlyType::Float64 || type == PlyType::Int32 || type == PlyType::UInt32;
            if (wide && roles[i].kind == Role::Position) return true;
        }
        return false;
    }
};

void check_against(const DecodeLimits& limits, const Layout& layout) {
    const std::uint64_t most =
        std::min<std::uint64_t>(limits.max_points, std::numeric_limits<Index>::max());
    if (layout.vertex->count > most) {
        throw Error(ErrorCode::TooLarge, "PLY header: " + std::to_string(layout.vertex->count) +
                                             " vertices: expected at most " + std::to_string(most) +
                                             "; split the cloud, or raise the limit");
    }
    const auto attributes = std::ranges::count(layout.roles, Role::Attribute, &Role::kind);
    if (std::cmp_greater(attributes, limits.max_attributes)) {
        throw Error(
            ErrorCode::TooLarge,
            "PLY header: " + std::to_string(attributes) +
                " properties of a vertex beside position, normal and colour: expected at most " +
                std::to_string(limits.max_attributes) + "; remove some, or raise the limit");
    }
    for (const PlyProperty& property : layout.vertex->properties) {
        if (!is_attribute_name(property.name)) {
            throw Error(ErrorCode::MalformedInput,
                        "PLY header: property " + in_quotes(property.name) +
                            " of element 'vertex': expected " + std::string(kAttributeNameRule));
        }
    }
}

Layout layout_of(std::span<const std::byte> file) {
    Layout layout{file, parse_ply_header(file), nullptr, {}};
    const auto& elements = layout.header.elements;
    const auto vertex = std::ranges::find(elements, "vertex", &PlyElement::name);
    if (vertex == elements.end()) {
        std::string names;
        for (const PlyElement& element : elements)
            names += (names.empty() ? "" : ", ") + in_quotes(element.name);
        throw Error(ErrorCode::MalformedInput,
                    "PLY header: no element 'vertex', which holds the points" +
                        (names.empty() ? "" : "; it has " + names));
    }
    layout.vertex = &*vertex;
    layout.roles = assign_roles(*vertex);
    return layout;
}

void describe(const Layout& layout, DecodeReport& report) {
    report.encoding = name_of(layout.header.encoding);
    report.points = layout.vertex->count;
    report.comments = layout.header.comments;
    report.skipped = layout.header.unknown_lines;
    for (const PlyElement& element : layout.header.elements) {
        if (&element == layout.vertex) continue;
        if (element.name == "face") report.faces = element.count;
        if (!element.has_list()) report.skipped.push_back(element.name);
        for (const PlyProperty& property : element.properties) {
            if (property.is_list()) report.skipped.push_back(element.name + "." + property.name);
        }
    }
}

// ---- Where the values of a property go

/// One component of a vector, as it is.
struct VectorSink {
    Vec3f* out;
    unsigned axis;
    template <typename T>
    void operator()(std::size_t row, T value) const noexcept {
        out[row][axis] = static_cast<float>(value);
    }
};

/// One coordinate, relative to an origin that is known.
struct GeoreferencedSink {
    Vec3f* out;
    unsigned axis;
    double origin;
    template <typename T>
    void operator()(std::size_t row, T value) const noexcept {
        out[row][axis] = static_cast<float>(static_cast<double>(value) - origin);
    }
};

/// One coordinate, kept until all are there and the origin can be chosen.
struct CoordinateSink {
    Vec3d* out;
    unsigned axis;
    template <typename T>
    void operator()(std::size_t row, T value) const noexcept {
        out[row][axis] = static_cast<double>(value);
    }
};

struct ColorSink {
    Rgba8* out;
    std::uint8_t Rgba8::*channel;
    template <typename T>
    void operator()(std::size_t row, T value) const noexcept {
        out[row].*channel = to_channel(value);
    }
};

/// A channel of 16 bits, kept until it is known whether the file uses them.
struct WideColorSink {
    WideColor* out;
    unsigned channel;
    template <typename T>
    void operator()(std::size_t row, T value) const noexcept {
        out[row][channel] = static_cast<std::uint16_t>(value);
    }
};

struct AttributeSink {
    AttributeValues* values;
    template <typename T>
    void operator()(std::size_t row, T value) const noexcept {
        (*std::get_if<std::vector<T>>(values))[row] = value;
    }
};

/// The lists of a property: kept while they have one length.
struct ListSink {
    AttributeValues values;
    std::optional<std::uint64_t> length;
    bool uniform = true;

    template <typename T, typename Cursor>
    void read(Cursor& cursor, const PlyProperty& property) {
        const std::uint64_t count = read_list_length(cursor, property);
        cursor.require(property, count);
        auto& kept = std::get<std::vector<T>>(values);
        if (!length) length = count;
        if (uniform && count != *length) {
            uniform = false;
            kept = {};
        }
        if (!uniform) return cursor.skip(property, count);
        for (std::uint64_t i = 0; i < count; ++i) kept.push_back(cursor.template read<T>(property));
    }
};

using Sink = std::variant<VectorSink, GeoreferencedSink, CoordinateSink, ColorSink, WideColorSink,
                          AttributeSink, ListSink*>;

struct Column {
    const PlyProperty* property;
    std::size_t offset;  ///< bytes from the start of a row, when no list stands before
    Sink sink;
};

AttributeValues values_of(PlyType type, std::size_t count) {
    return with_type(type, [&]<typename T>() { return AttributeValues(std::vector<T>(count)); });
}

/// The cloud as it is filled. Not to be copied: the columns point into it.
class Destination {
public:
    std::vector<Column> columns;

    /// @param origin  when known; else wide coordinates are collected and `finish` chooses one.
    Destination(const Layout& layout, std::optional<Vec3d> origin)
        : layout_(layout), wide_(layout.wide_coordinates()), origin_(origin) {
        allocate();
        std::size_t offset = 0;
        std::size_t attribute = 0;
        for (std::size_t i = 0; i < layout.roles.size(); ++i) {
            const PlyProperty& property = layout.vertex->properties[i];
            columns.push_back({&property, offset, sink_for(layout.roles[i], property, attribute)});
            offset += size_of(property.type);
        }
    }
    Destination(const Destination&) = delete;
    Destination& operator=(const Destination&) = delete;

    std::size_t rows() const noexcept { return cloud_.positions.size(); }

    PointCloud finish(DecodeReport& report) {
        if (wide_ && !origin_) place_coordinates();
        if (!wide_colors_.empty()) narrow_colors(wide_colors_, cloud_.colors);
        cloud_.origin = origin_.value_or(Vec3d::Zero());
        cloud_.double_precision = wide_;
        for (auto& [property, sink] : lists_) keep_or_report(*property, sink, report);
        return std::move(cloud_);
    }

private:
    void allocate() {
        const auto n = static_cast<std::size_t>(layout_.vertex->count);
        cloud_.positions.resize(n);
        if (wide_ && !origin_) coordinates_.resize(n);
        if (layout_.has(Role::Normal)) cloud_.normals.resize(n);
        if (layout_.has(Role::Color)) cloud_.colors.resize(n);
        if (has_wide_colors()) wide_colors_.resize(n, kOpaque);
        cloud_.has_alpha = layout_.has(Role::Color, 3);
        for (std::size_t i = 0; i < layout_.roles.size(); ++i) {
            const PlyProperty& property = layout_.vertex->properties[i];
            if (layout_.roles[i].kind != Role::Attribute || property.is_list()) continue;
            AttributeValues values = values_of(property.type, n);
            const Reduction reduction = default_reduction(values);
            cloud_.attributes.push_back({property.name, std::move(values), 1, reduction});
        }
    }

    /// Whether all channels have 16 bits.
    bool has_wide_colors() const {
        bool any = false;
        for (std::size_t i = 0; i < layout_.roles.size(); ++i) {
            if (layout_.roles[i].kind != Role::Color) continue;
            if (layout_.vertex->properties[i].type != PlyType::UInt16) return false;
            any = true;
        }
        return any;
    }

    Sink sink_for(const Role& role, const PlyProperty& property, std::size_t& attribute) {
        constexpr std::array kChannels = {&Rgba8::r, &Rgba8::g, &Rgba8::b, &Rgba8::a};
        switch (role.kind) {
            case Role::Position:
                if (!wide_) return VectorSink{cloud_.positions.data(), role.component};
                if (!origin_) return CoordinateSink{coordinates_.data(), role.component};
                return GeoreferencedSink{cloud_.positions.data(), role.component,
                                         (*origin_)[role.component]};
            case Role::Normal:
                return VectorSink{cloud_.normals.data(), role.component};
            case Role::Color:
                if (!wide_colors_.empty())
                    return WideColorSink{wide_colors_.data(), role.component};
                return ColorSink{cloud_.colors.data(), kChannels[role.component]};
            case Role::Attribute:
                break;
        }
        if (!property.is_list()) return AttributeSink{&cloud_.attributes[attribute++].values};
        lists_.emplace_back(&property, ListSink{values_of(property.type, 0), {}, true});
        return &lists_.back().second;
    }

    void place_coordinates() {
        Aabb box;
        for (const Vec3d& p : coordinates_) {
            if (!p.allFinite()) continue;
            box.min = box.min.cwiseMin(p);
            box.max = box.max.cwiseMax(p);
        }
        origin_ = choose_origin(box);
        for (std::size_t i = 0; i < coordinates_.size(); ++i) {
            cloud_.positions[i] = (coordinates_[i] - *origin_).cast<float>();
        }
        coordinates_ = {};
    }

    void keep_or_report(const PlyProperty& property, ListSink& list, DecodeReport& report) {
        if (!list.uniform || list.length.value_or(0) == 0) {
            report.skipped.push_back("vertex." + property.name);
            return;
        }
        const Reduction reduction = default_reduction(list.values);
        cloud_.attributes.push_back({property.name, std::move(list.values),
                                     static_cast<unsigned>(*list.length), reduction});
    }

    const Layout& layout_;
    const bool wide_;
    std::optional<Vec3d> origin_;
    PointCloud cloud_;
    std::vector<Vec3d> coordinates_;
    std::vector<WideColor> wide_colors_;  ///< where all channels have 16 bits
    std::deque<std::pair<const PlyProperty*, ListSink>> lists_;  // a deque: columns point into it
};

// ---- Value after value

/// Reads one value, or list, of a column from a cursor; chosen once a column.
template <typename Cursor>
using ReadColumn = void (*)(Cursor&, const Column&, std::size_t row);

template <typename Cursor>
ReadColumn<Cursor> reader_of(const Column& column) {
    return with_type(column.property->type, [&]<typename T>() {
        return std::visit(
            []<typename S>(const S&) -> ReadColumn<Cursor> {
                return [](Cursor& cursor, const Column& c, std::size_t row) {
                    const S& sink = *std::get_if<S>(&c.sink);
                    if constexpr (std::is_same_v<S, ListSink*>) {
                        sink->template read<T>(cursor, *c.property);
                    } else {
                        sink(row, cursor.template read<T>(*c.property));
                    }
                };
            },
            column.sink);
    });
}

template <typename Cursor>
class RowReader {
public:
    explicit RowReader(const std::vector<Column>& columns) : columns_(columns) {
        for (const Column& column : columns) readers_.push_back(reader_of<Cursor>(column));
    }
    void operator()(Cursor& cursor, std::size_t row) const {
        cursor.place.row = row;
        for (std::size_t i = 0; i < readers_.size(); ++i) readers_[i](cursor, columns_[i], row);
    }

private:
    const std::vector<Column>& columns_;
    std::vector<ReadColumn<Cursor>> readers_;
};

constexpr std::uint64_t kRowsBetweenCheckpoints = 1 << 16;

template <typename Cursor>
void skip_element(Cursor& cursor, const PlyElement& element, const RunContext& context) {
    cursor.place = {&element, 0};
    cursor.require(element);
    if (element.properties.empty()) return;
    for (; cursor.place.row < element.count; ++cursor.place.row) {
        if (cursor.place.row % kRowsBetweenCheckpoints == 0) context.throw_if_stopped();
        for (const PlyProperty& property : element.properties) {
            cursor.skip(property, property.is_list() ? read_list_length(cursor, property) : 1);
        }
    }
}

// ---- Binary bodies

/// Passes lists that are all as long as the first, as the triangles of nearly every file: each is
/// where that length says, so no step waits for the one before. False, and nothing passed, when
/// they are not.
template <bool kSwap>
bool skip_equal_lists(BinaryCursor<kSwap>& cursor, std::size_t lists, std::size_t size) {
    const std::byte first = *cursor.position();
    const std::size_t stride = 1 + std::to_integer<std::size_t>(first) * size;
    if (lists > cursor.remaining() / stride) return false;
    std::byte difference{0};
    for (std::size_t i = 0; i < lists; ++i) difference |= cursor.position()[i * stride] ^ first;
    if (difference != std::byte{0}) return false;
    cursor.advance(lists * stride);
    return true;
}

/// The faces of nearly every file: one list with a length of one byte.
template <bool kSwap>
bool skip_short_lists(BinaryCursor<kSwap>& cursor, const PlyElement& element) {
    if (element.properties.size() != 1 || element.properties[0].count_type != PlyType::UInt8)
        return false;
    const std::size_t size = size_of(element.properties[0].type);
    auto left = static_cast<std::size_t>(element.count);
    if (left == 0 || skip_equal_lists(cursor, left, size)) return true;
    // While even the longest list fits, nothing needs to be checked.
    const std::size_t longest = 1 + 255 * size;
    for (; left != 0 && cursor.remaining() >= longest; --left) {
        cursor.advance(1 + std::to_integer<std::size_t>(*cursor.position()) * size);
    }
    for (; left != 0; --left) {
        cursor.place.row = element.count - left;
        cursor.skip(element.properties[0], read_list_length(cursor, element.properties[0]));
    }
    return true;
}

template <bool kSwap>
void skip_binary_element(BinaryCursor<kSwap>& cursor, const PlyElement& element,
                         const RunContext& context) {
    cursor.place = {&element, 0};
    cursor.require(element);
    if (!element.has_list()) return cursor.advance(element.count * element.least_bytes());
    if (!skip_short_lists(cursor, element)) skip_element(cursor, element, context);
}

/// Whether the elements, read from `from` on, end exactly where the file does.
template <bool kSwap>
bool fits_exactly(const Layout& layout, std::size_t from, const RunContext& context) {
    BinaryCursor<kSwap> cursor(layout.file, from);
    try {
        for (const PlyElement& element : layout.header.elements)
            skip_binary_element(cursor, element, context);
    } catch (const Error&) {
        return false;
    }
    return cursor.remaining() == 0;
}

/// Assimp 5.4 wrote an empty line before its binary bodies. It is passed only when the file fits
/// with it and not without.
template <bool kSwap>
std::size_t body_start(const Layout& layout, const RunContext& context) {
    const std::size_t body = layout.header.body;
    const bool stray = body < layout.file.size() && layout.file[body] == std::byte{'\n'} &&
                       !fits_exactly<kSwap>(layout, body, context) &&
                       fits_exactly<kSwap>(layout, body + 1, context);
    return body + (stray ? 1 : 0);
}

constexpr std::size_t kRowsPerBlock = 8192;

/// `parallel_for_blocks` that also reports progress.
template <typename Body>
void for_blocks_of_rows(std::size_t rows, const RunContext& context, const Body& body) {
    constexpr std::size_t kRowsPerReport = 128 * kRowsPerBlock;
    for (std::size_t first = 0; first < rows; first += kRowsPerReport) {
        context.checkpoint(static_cast<double>(first) / static_cast<double>(rows));
        parallel_for_blocks(
            std::min(kRowsPerReport, rows - first), kRowsPerBlock, context,
            [&](std::size_t begin, std::size_t end) { body(first + begin, first + end); });
    }
}

/// Rows of one length, one after the other.
struct Rows {
    const std::byte* data;
    std::size_t stride;
};

template <bool kSwap>
Aabb bounds_of_coordinates(const Rows& rows, const Layout& layout, const RunContext& context) {
    const auto n = static_cast<std::size_t>(layout.vertex->count);
    std::vector<Aabb> boxes((n + kRowsPerBlock - 1) / kRowsPerBlock);
    parallel_for_blocks(n, kRowsPerBlock, context, [&](std::size_t begin, std::size_t end) {
        Aabb& box = boxes[begin / kRowsPerBlock];
        std::size_t offset = 0;
        for (std::size_t i = 0; i < layout.roles.size(); ++i) {
            const PlyType type = layout.vertex->properties[i].type;
            if (layout.roles[i].kind == Role::Position) {
                const unsigned axis = layout.roles[i].component;
                with_type(type, [&]<typename T>() {
                    for (std::size_t row = begin; row < end; ++row) {
                        const auto value =
                            static_cast<double>(BinaryCursor<kSwap>::template load<T>(
                                rows.data + row * rows.stride + offset));
                        if (!std::isfinite(value)) continue;
                        box.min[axis] = std::min(box.min[axis], value);
                        box.max[axis] = std::max(box.max[axis], value);
                    }
                });
            }
            offset += size_of(type);
        }
    });
    return std::accumulate(boxes.begin(), boxes.end(), Aabb{}, [](const Aabb& a, const Aabb& b) {
        return Aabb{a.min.cwiseMin(b.min), a.max.cwiseMax(b.max)};
    });
}

/// Whether the column and the two after it are the floats of a vector, side by side in the file as
/// in memory.
bool is_plain_vector(std::span<const Column> columns) {
    if (columns.size() < 3) return false;
    const auto* const first = std::get_if<VectorSink>(&columns[0].sink);
    for (unsigned axis = 0; axis < 3; ++axis) {
        const auto* const sink = std::get_if<VectorSink>(&columns[axis].sink);
        if (sink == nullptr || sink->out != first->out || sink->axis != axis) return false;
        if (columns[axis].property->type != PlyType::Float32) return false;
    }
    return true;
}

void copy_vectors(const Rows& rows, const Column& column, std::size_t begin, std::size_t end) {
    Vec3f* const out = std::get<VectorSink>(column.sink).out;
    static_assert(sizeof(Vec3f) == 12);
    const std::byte* from = rows.data + begin * rows.stride + column.offset;
    if (rows.stride == sizeof(Vec3f)) {
        std::memcpy(out[begin].data(), from, (end - begin) * sizeof(Vec3f));
        return;
    }
    for (std::size_t row = begin; row < end; ++row, from += rows.stride) {
        std::memcpy(out[row].data(), from, sizeof(Vec3f));
    }
}

template <bool kSwap>
void decode_column(const Rows& rows, const Column& column, std::size_t begin, std::size_t end) {
    with_type(column.property->type, [&]<typename T>() {
        std::visit(
            [&]<typename S>(const S& sink) {
                if constexpr (!std::is_same_v<S, ListSink*>) {
                    const std::byte* from = rows.data + begin * rows.stride + column.offset;
                    for (std::size_t row = begin; row < end; ++row, from += rows.stride) {
                        sink(row, BinaryCursor<kSwap>::template load<T>(from));
                    }
                }
            },
            column.sink);
    });
}

template <bool kSwap>
PointCloud decode_rows(BinaryCursor<kSwap>& cursor, const Layout& layout, const RunContext& context,
                       DecodeReport& report) {
    const Rows rows{cursor.position(), static_cast<std::size_t>(layout.vertex->least_bytes())};
    cursor.advance(layout.vertex->count * rows.stride);
    std::optional<Vec3d> origin;
    if (layout.wide_coordinates())
        origin = choose_origin(bounds_of_coordinates<kSwap>(rows, layout, context));
    Destination destination(layout, origin);
    for_blocks_of_rows(destination.rows(), context, [&](std::size_t begin, std::size_t end) {
        std::span<const Column> columns = destination.columns;
        while (!columns.empty()) {
            if (!kSwap && is_plain_vector(columns)) {
                copy_vectors(rows, columns[0], begin, end);
                columns = columns.subspan(3);
            } else {
                decode_column<kSwap>(rows, columns[0], begin, end);
                columns = columns.subspan(1);
            }
        }
    });
    return destination.finish(report);
}

template <typename Cursor>
PointCloud decode_values(Cursor& cursor, const Layout& layout, const RunContext& context,
                         DecodeReport& report) {
    Destination destination(layout, std::nullopt);
    const RowReader<Cursor> read_row(destination.columns);
    for (std::size_t row = 0; row < destination.rows(); ++row) {
        if (row % kRowsBetweenCheckpoints == 0) {
            context.checkpoint(static_cast<double>(row) / static_cast<double>(destination.rows()));
        }
        read_row(cursor, row);
    }
    return destination.finish(report);
}

template <bool kSwap>
PointCloud decode_binary(const Layout& layout, const RunContext& context, DecodeReport& report) {
    BinaryCursor<kSwap> cursor(layout.file, body_start<kSwap>(layout, context));
    PointCloud cloud;
    for (const PlyElement& element : layout.header.elements) {
        if (&element != layout.vertex) {
            skip_binary_element(cursor, element, context);
            continue;
        }
        cursor.place = {&element, 0};
        cursor.require(element);
        cloud = element.has_list() ? decode_values(cursor, layout, context, report)
                                   : decode_rows(cursor, layout, context, report);
    }
    return cloud;
}

// ---- Text bodies

/// Whether the first vertex has a line to itself, as in all but hand-made files. Then every one
/// must.
bool starts_with_one_per_line(AsciiCursor cursor, std::size_t values) {
    cursor.skip_blanks();
    for (std::size_t i = 0; i < values; ++i) {
        if (cursor.at_end_of_line()) return false;
        cursor.seek(
            cursor.position() +
            ply_number::word_at(cursor.position(), cursor.position() + cursor.remaining()).size());
    }
    return cursor.at_end_of_line();
}

constexpr std::size_t kTextPerBlock = std::size_t{1} << 18;

/// Lines of text cut into blocks of bytes: a line belongs to the block that holds the newline
/// before it.
struct TextBlocks {
    std::string_view text;
    std::vector<std::size_t> newlines_before;  ///< of each block; at the end, of all

    std::size_t size() const noexcept { return newlines_before.size() - 1; }
    std::size_t newlines() const noexcept { return newlines_before.back(); }
    std::string_view block(std::size_t b) const {
        return text.substr(b * kTextPerBlock, kTextPerBlock);
    }
};

/// `std::count` of newlines, eight bytes at a time.
std::size_t count_newlines(const char* p, const char* end) {
    constexpr std::uint64_t kOnes = 0x0101010101010101;
    constexpr std::uint64_t kLow = 0x7f * kOnes;
    std::size_t newlines = 0;
    for (; end - p >= 8; p += 8) {
        std::uint64_t bytes;
        std::memcpy(&bytes, p, 8);
        bytes ^= '\n' * kOnes;
        // The high bit of each byte that is zero now.
        newlines +=
            static_cast<std::size_t>(std::popcount(~(((bytes & kLow) + kLow) | bytes | kLow)));
    }
    return newlines + static_cast<std::size_t>(std::count(p, end, '\n'));
}

TextBlocks cut_into_blocks(std::string_view text, const RunContext& context) {
    TextBlocks blocks{
        text, std::vector<std::size_t>((text.size() + kTextPerBlock - 1) / kTextPerBlock + 1)};
    parallel_for_blocks(text.size(), kTextPerBlock, context,
                        [&](std::size_t begin, std::size_t end) {
                            blocks.newlines_before[begin / kTextPerBlock + 1] =
                                count_newlines(text.data() + begin, text.data() + end);
                        });
    std::partial_sum(blocks.newlines_before.begin(), blocks.newlines_before.end(),
                     blocks.newlines_before.begin());
    return blocks;
}

/// Reads line after line until `rows` are there, passing blank lines.
void read_lines(AsciiCursor& cursor, const RowReader<AsciiCursor>& read_row, std::size_t rows,
                const RunContext& context) {
    cursor.within_line = true;
    for (std::size_t row = 0; row < rows; ++row) {
        if (row % kRowsBetweenCheckpoints == 0) {
            context.checkpoint(static_cast<double>(row) / static_cast<double>(rows));
        }
        cursor.skip_blanks();
        read_row(cursor, row);
        cursor.expect_end_of_line();
    }
    cursor.within_line = false;
}

enum class BlockOutcome { Read, HasBlankLine };

/// Reads the vertices on the lines of one block.
BlockOutcome read_block(AsciiCursor cursor, const TextBlocks& blocks, std::size_t b,
                        const RowReader<AsciiCursor>& read_row, std::size_t rows) {
    cursor.within_line = true;
    const char* line = b == 0 ? blocks.text.data() : nullptr;
    std::size_t row = b == 0 ? 0 : blocks.newlines_before[b] + 1;
    const std::size_t end = std::min(rows, blocks.newlines_before[b + 1] + 1);
    if (row >= end) return BlockOutcome::Read;
    if (line == nullptr) line = blocks.block(b).data() + blocks.block(b).find('\n') + 1;
    for (cursor.seek(line); row < end; ++row) {
        if (cursor.at_end_of_line()) return BlockOutcome::HasBlankLine;
        read_row(cursor, row);
        cursor.expect_end_of_line();
        if (cursor.remaining() != 0) cursor.seek(cursor.position() + 1);
    }
    return BlockOutcome::Read;
}

/// Reads one vertex a line, in parallel. False when the lines are not where they were expected:
/// then nothing is known.
bool read_lines_in_blocks(const AsciiCursor& cursor, const TextBlocks& blocks,
                          const RowReader<AsciiCursor>& read_row, std::size_t rows,
                          const RunContext& context) {
    if (blocks.newlines() + 1 < rows) return false;
    const auto last = std::ranges::lower_bound(blocks.newlines_before, rows);
    const auto used = std::min(static_cast<std::size_t>(last - blocks.newlines_before.begin()) + 1,
                               blocks.size());
    std::vector<BlockOutcome> outcomes(used, BlockOutcome::Read);
    std::vector<std::exception_ptr> faults(used);
    constexpr std::size_t kBlocksPerReport = 64;
    for (std::size_t first = 0; first < used; first += kBlocksPerReport) {
        context.checkpoint(static_cast<double>(first) / static_cast<double>(used));
        parallel_for_blocks(
            std::min(kBlocksPerReport, used - first), 1, context, [&](std::size_t b, std::size_t) {
                try {
                    outcomes[first + b] = read_block(cursor, blocks, first + b, read_row, rows);
                } catch (const Error&) {
                    faults[first + b] = std::current_exception();
                }
            });
    }
    if (std::ranges::find(outcomes, BlockOutcome::HasBlankLine) != outcomes.end()) return false;
    // The first in the file, whichever thread found one first.
    for (const std::exception_ptr& fault : faults) {
        if (fault) std::rethrow_exception(fault);
    }
    return true;
}

const char* end_of_lines(const TextBlocks& blocks, std::size_t lines) {
    const char* const end = blocks.text.data() + blocks.text.size();
    if (lines == 0) return blocks.text.data();
    if (blocks.newlines() < lines) return end;
    const auto after = std::ranges::lower_bound(blocks.newlines_before, lines);
    const auto b = static_cast<std::size_t>(after - blocks.newlines_before.begin()) - 1;
    const char* position = blocks.block(b).data();
    for (std::size_t left = lines - blocks.newlines_before[b]; left != 0; --left) {
        position = std::find(position, end, '\n') + 1;
    }
    return position;
}

/// What follows the vertices is not kept, but it must be there. Counting lines settles that for
/// nearly every file.
void check_following(AsciiCursor cursor, std::span<const PlyElement> following,
                     const TextBlocks& blocks, std::size_t rows, const RunContext& context) {
    double expected = static_cast<double>(rows);
    for (const PlyElement& element : following) {
        if (!element.properties.empty()) expected += static_cast<double>(element.count);
    }
    const std::size_t lines = blocks.newlines() + (blocks.text.ends_with('\n') ? 0 : 1);
    if (static_cast<double>(lines) >= expected) return;
    cursor.seek(end_of_lines(blocks, rows));
    for (const PlyElement& element : following) skip_element(cursor, element, context);
}

PointCloud decode_ascii(const Layout& layout, const RunContext& context, DecodeReport& report) {
    AsciiCursor cursor(layout.file, layout.header.body);
    const auto& elements = layout.header.elements;
    const PlyElement* const vertex = layout.vertex;
    for (const PlyElement* element = elements.data(); element != vertex; ++element) {
        skip_element(cursor, *element, context);
    }
    const std::span<const PlyElement> following(vertex + 1, elements.data() + elements.size());

    cursor.place = {vertex, 0};
    cursor.require(*vertex);
    cursor.skip_blanks();
    const bool lists = vertex->has_list();
    if (lists || !starts_with_one_per_line(cursor, vertex->properties.size())) {
        PointCloud cloud = decode_values(cursor, layout, context, report);
        for (const PlyElement& element : following) skip_element(cursor, element, context);
        return cloud;
    }

    Destination destination(layout, std::nullopt);
    const RowReader<AsciiCursor> read_row(destination.columns);
    const TextBlocks blocks = cut_into_blocks({cursor.position(), cursor.remaining()}, context);
    const std::size_t rows = destination.rows();
    if (!read_lines_in_blocks(cursor, blocks, read_row, rows, context)) {
        read_lines(cursor, read_row, rows, context);
        for (const PlyElement& element : following) skip_element(cursor, element, context);
    } else {
        check_following(cursor, following, blocks, rows, context);
    }
    return destination.finish(report);
}

}  // namespace

PointCloud decode_ply(std::span<const std::byte> file, const DecodeLimits& limits,
                      const RunContext& context, DecodeReport& report) {
    const Layout layout = layout_of(file);
    check_against(limits, layout);
    describe(layout, report);
    constexpr bool kNativeIsBig = std::endian::native == std::endian::big;
    switch (layout.header.encoding) {
        case PlyEncoding::BinaryLittleEndian:
            return decode_binary<kNativeIsBig>(layout, context, report);
        case PlyEncoding::BinaryBigEndian:
            return decode_binary<!kNativeIsBig>(layout, context, report);
        case PlyEncoding::Ascii:
            break;
    }
    return decode_ascii(layout, context, report);
}

}  // namespace stipple
