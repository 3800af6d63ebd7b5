#pragma once

#include "cloud/color_channel.hpp"
#include "cloud/whole_numbers.hpp"
#include "codec/ply_cursor.hpp"
#include "codec/ply_layout.hpp"
#include "stipple/point_cloud.hpp"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <utility>
#include <variant>
#include <vector>

namespace stipple {

// Where the values of a property go.

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

/// A channel, kept until it is known what the file means by it.
template <typename Channel>
struct WideColorSink {
    typename WideColors<Channel>::Color* out;
    unsigned channel;
    template <typename T>
    void operator()(std::size_t row, T value) const noexcept {
        out[row][channel] = to_wide_channel<Channel>(value);
    }
};

struct AttributeSink {
    AttributeValues* values;
    std::atomic<bool>* rounded;  ///< set where a value is not kept as it is
    template <typename T>
    void operator()(std::size_t row, T value) const noexcept {
        if constexpr (std::is_integral_v<T>)
            if (!fits_double(value)) rounded->store(true, std::memory_order_relaxed);
        (*std::get_if<std::vector<Kept<T>>>(values))[row] = static_cast<Kept<T>>(value);
    }
};

/// The lists of a property: kept while they have one length.
struct ListSink {
    AttributeValues values;
    std::optional<std::uint64_t> length;
    bool uniform = true;
    bool rounded = false;  ///< a value is not kept as it is

    template <typename T, typename Cursor>
    void read(Cursor& cursor, const PlyProperty& property) {
        const std::uint64_t count = read_list_length(cursor, property);
        cursor.require(property, count);
        auto& kept = std::get<std::vector<Kept<T>>>(values);
        if (!length) length = count;
        if (uniform && count != *length) {
            uniform = false;
            kept = {};
        }
        if (!uniform) return cursor.skip(property, count);
        for (std::uint64_t i = 0; i < count; ++i) {
            const T value = cursor.template read<T>(property);
            if constexpr (std::is_integral_v<T>) rounded = rounded || !fits_double(value);
            kept.push_back(static_cast<Kept<T>>(value));
        }
    }
};

using PlySink =
    std::variant<VectorSink, GeoreferencedSink, CoordinateSink, ColorSink,
                 WideColorSink<std::uint16_t>, WideColorSink<float>, AttributeSink, ListSink*>;

struct PlyColumn {
    const PlyProperty* property;
    std::size_t offset;  ///< bytes from the start of a row, when no list stands before
    PlySink sink;
};

/// The cloud as it is filled. Not to be copied: the columns point into it.
class PlyDestination {
public:
    std::vector<PlyColumn> columns;

    /// @param origin  when known; else wide coordinates are collected and `finish` chooses one.
    PlyDestination(const PlyLayout& layout, std::optional<Vec3d> origin);
    PlyDestination(const PlyDestination&) = delete;
    PlyDestination& operator=(const PlyDestination&) = delete;

    std::size_t rows() const noexcept { return cloud_.positions.size(); }

    PointCloud finish(DecodeReport& report);

private:
    void allocate();
    /// Whether there are colours, and red, green and blue are of one of these types.
    bool colors_are(std::span<const PlyType> types) const;
    void keep_colors(std::span<const PlyType> types, auto& colors);
    PlySink sink_for(const PlyRole& role, const PlyProperty& property, std::size_t& attribute);
    void scale_normals();
    void place_coordinates();
    void keep_or_report(const PlyProperty& property, ListSink& list, DecodeReport& report);

    const PlyLayout& layout_;
    const bool wide_;
    std::optional<Vec3d> origin_;
    PointCloud cloud_;
    std::vector<Vec3d> coordinates_;
    WideColors<std::uint16_t> wide_colors_;  ///< where the channels have 16 bits or more,
    WideColors<float> float_colors_;         ///< or are floats
    bool alpha_apart_ = false;               ///< it is of neither kind, though they are
    // Deques: columns point into them.
    std::deque<std::pair<const PlyProperty*, std::atomic<bool>>> roundings_;
    std::deque<std::pair<const PlyProperty*, ListSink>> lists_;
};

// Value after value.

/// Reads one value, or list, of a column from a cursor; chosen once a column.
template <typename Cursor>
using ReadColumn = void (*)(Cursor&, const PlyColumn&, std::size_t row);

template <typename Cursor>
ReadColumn<Cursor> reader_of(const PlyColumn& column) {
    return with_type(column.property->type, [&]<typename T>() {
        return std::visit(
            []<typename S>(const S&) -> ReadColumn<Cursor> {
                return [](Cursor& cursor, const PlyColumn& c, std::size_t row) {
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
    explicit RowReader(const std::vector<PlyColumn>& columns) : columns_(columns) {
        for (const PlyColumn& column : columns) readers_.push_back(reader_of<Cursor>(column));
    }
    void operator()(Cursor& cursor, std::size_t row) const {
        cursor.place.row = row;
        for (std::size_t i = 0; i < readers_.size(); ++i) readers_[i](cursor, columns_[i], row);
    }

private:
    const std::vector<PlyColumn>& columns_;
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

template <typename Cursor>
PointCloud decode_values(Cursor& cursor, const PlyLayout& layout, const RunContext& context,
                         DecodeReport& report) {
    PlyDestination destination(layout, std::nullopt);
    const RowReader<Cursor> read_row(destination.columns);
    for (std::size_t row = 0; row < destination.rows(); ++row) {
        if (row % kRowsBetweenCheckpoints == 0) {
            context.checkpoint(static_cast<double>(row) / static_cast<double>(destination.rows()));
        }
        read_row(cursor, row);
    }
    return destination.finish(report);
}

}  // namespace stipple
