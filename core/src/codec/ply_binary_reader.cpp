#include "codec/ply_body.hpp"

#include "base/parallel_for.hpp"
#include "cloud/box_of_most.hpp"
#include "cloud/georeference.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

// Rows of fixed length are decoded column by column over blocks of rows; only vertices with lists
// are read value after value.

namespace stipple {

namespace {

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
bool fits_exactly(const PlyLayout& layout, std::size_t from, const RunContext& context) {
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
std::size_t body_start(const PlyLayout& layout, const RunContext& context) {
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
Vec3d coordinate(const Rows& rows, const PlyLayout& layout, std::size_t row) {
    Vec3d p = Vec3d::Zero();
    const std::byte* from = rows.data + row * rows.stride;
    for (std::size_t i = 0; i < layout.roles.size(); ++i) {
        const PlyType type = layout.vertex->properties[i].type;
        if (layout.roles[i].kind == PlyRole::Position) {
            p[layout.roles[i].component] = with_type(type, [&]<typename T>() {
                return static_cast<double>(BinaryCursor<kSwap>::template load<T>(from));
            });
        }
        from += size_of(type);
    }
    return p;
}

template <bool kSwap>
Aabb bounds_of_coordinates(const Rows& rows, const PlyLayout& layout, const RunContext& context) {
    const auto n = static_cast<std::size_t>(layout.vertex->count);
    std::vector<Aabb> boxes((n + kRowsPerBlock - 1) / kRowsPerBlock);
    parallel_for_blocks(n, kRowsPerBlock, context, [&](std::size_t begin, std::size_t end) {
        Aabb& box = boxes[begin / kRowsPerBlock];
        bool is_finite = true;
        std::size_t offset = 0;
        for (std::size_t i = 0; i < layout.roles.size(); ++i) {
            const PlyType type = layout.vertex->properties[i].type;
            if (layout.roles[i].kind == PlyRole::Position) {
                const unsigned axis = layout.roles[i].component;
                with_type(type, [&]<typename T>() {
                    for (std::size_t row = begin; row < end; ++row) {
                        const auto value =
                            static_cast<double>(BinaryCursor<kSwap>::template load<T>(
                                rows.data + row * rows.stride + offset));
                        is_finite = is_finite && std::isfinite(value);
                        box.min[axis] = std::min(box.min[axis], value);
                        box.max[axis] = std::max(box.max[axis], value);
                    }
                });
            }
            offset += size_of(type);
        }
        if (is_finite) return;
        box = {};  // without points that have no place, whatever their other coordinates are
        for (std::size_t row = begin; row < end; ++row) {
            const Vec3d p = coordinate<kSwap>(rows, layout, row);
            if (!p.allFinite()) continue;
            box.min = box.min.cwiseMin(p);
            box.max = box.max.cwiseMax(p);
        }
    });
    return std::accumulate(boxes.begin(), boxes.end(), Aabb{}, [](const Aabb& a, const Aabb& b) {
        return Aabb{a.min.cwiseMin(b.min), a.max.cwiseMax(b.max)};
    });
}

/// Whether the column and the two after it are the floats of a vector, side by side in the file as
/// in memory.
bool is_plain_vector(std::span<const PlyColumn> columns) {
    if (columns.size() < 3) return false;
    const auto* const first = std::get_if<VectorSink>(&columns[0].sink);
    for (unsigned axis = 0; axis < 3; ++axis) {
        const auto* const sink = std::get_if<VectorSink>(&columns[axis].sink);
        if (sink == nullptr || sink->out != first->out || sink->axis != axis) return false;
        if (columns[axis].property->type != PlyType::Float32) return false;
    }
    return true;
}

void copy_vectors(const Rows& rows, const PlyColumn& column, std::size_t begin, std::size_t end) {
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
void decode_column(const Rows& rows, const PlyColumn& column, std::size_t begin, std::size_t end) {
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
PointCloud decode_rows(BinaryCursor<kSwap>& cursor, const PlyLayout& layout,
                       const RunContext& context, DecodeReport& report) {
    const Rows rows{cursor.position(), static_cast<std::size_t>(layout.vertex->least_bytes())};
    cursor.advance(layout.vertex->count * rows.stride);
    std::optional<Vec3d> origin;
    if (layout.wide_coordinates())
        origin = choose_origin(
            bounds_of_coordinates<kSwap>(rows, layout, context),
            some_of(static_cast<std::size_t>(layout.vertex->count),
                    [&](std::size_t row) { return coordinate<kSwap>(rows, layout, row); }));
    PlyDestination destination(layout, origin);
    for_blocks_of_rows(destination.rows(), context, [&](std::size_t begin, std::size_t end) {
        std::span<const PlyColumn> columns = destination.columns;
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

/// Less than a point may be a line's end; but of points that were passed as faces any part may be
/// left.
bool is_surplus(std::span<const std::byte> rest, const PlyLayout& layout, bool after_vertices) {
    if (after_vertices)
        return rest.size() >= std::max<std::uint64_t>(1, layout.vertex->least_bytes());
    return !std::ranges::all_of(
        rest, [](std::byte b) { return ply_number::is_blank(std::to_integer<char>(b)); });
}

template <bool kSwap>
PointCloud decode(const PlyLayout& layout, const RunContext& context, DecodeReport& report) {
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
    const bool after_vertices = &layout.header.elements.back() == layout.vertex;
    const std::span rest(cursor.position(), cursor.remaining());
    if (is_surplus(rest, layout, after_vertices))
        report.skipped.push_back(std::to_string(rest.size()) +
                                 (rest.size() == 1 ? " byte" : " bytes") +
                                 surplus_place(after_vertices));
    return cloud;
}

}  // namespace

PointCloud decode_binary_ply(const PlyLayout& layout, const RunContext& context,
                             DecodeReport& report) {
    constexpr auto kNative = std::endian::native == std::endian::big
                                 ? PlyEncoding::BinaryBigEndian
                                 : PlyEncoding::BinaryLittleEndian;
    return layout.header.encoding == kNative ? decode<false>(layout, context, report)
                                             : decode<true>(layout, context, report);
}

}  // namespace stipple
