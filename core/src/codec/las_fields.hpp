#pragma once

#include "codec/laz_chunk.hpp"
#include "stipple/point_cloud.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stipple {

/// What the record has that tells of the extra bytes of a point: its size is one of 16 bits.
inline constexpr std::size_t kExtraFieldSize = 192, kMostExtraFields = 0xFFFF / kExtraFieldSize;

/// A field that LAS does not know: among the extra bytes of a point.
struct LasExtraField {
    std::string name;                  ///< 1 to 32 bytes; no other field with values has it
    std::uint8_t type = 0;             ///< as LAS numbers types
    std::size_t size = 0, stride = 0;  ///< bytes: of a value; from one point to the next
    const std::byte* first = nullptr;  ///< the value of point 0 of the cloud
};

/// What a cloud has beside positions and colours, as the points of a LAS file have it; in the order
/// of the cloud, which must outlive it. Attributes that are named like fields of LAS (in any case,
/// with or without underscores, or "scalar_" before them), and whose values such a field can hold,
/// are that field: intensity, classification, user_data, point_source_id, gps_time, the flags, and
/// return_number with number_of_returns. Where such a field cannot hold the values of a few points
/// it is 0 there (of returns: 1 of 1), and the extra bytes have all of them, too.
struct LasFields {
    // Of each point, or empty.
    std::vector<std::uint16_t> intensities, sources;
    std::vector<std::uint8_t> classifications, user_data, flags;
    std::vector<LazReturn> returns;
    std::vector<double> times;
    std::vector<LasExtraField> extras;
    std::size_t extra_size = 0;    ///< bytes of all extras of a point
    std::vector<std::string> odd;  ///< what has values that LAS's field cannot hold, in words

    /// @throws Error(InvalidArgument) for more than a file can tell of.
    explicit LasFields(const PointCloud& cloud);

private:
    bool take_as_known(const Attribute& attribute);
    bool take_flag(const Attribute& attribute);
    void take_returns(const PointCloud& cloud);
    bool admit(const std::string& name, std::size_t odd_points, std::size_t points,
               std::string_view instead = "0");
    void require_room(std::span<const Attribute* const> others) const;
    const Attribute *return_number_ = nullptr,
                    *return_count_ = nullptr;  ///< those taken as a whole
    std::uint8_t flags_taken_ = 0;
    void add(const Attribute& attribute);
    void add(LasExtraField field);
};

}  // namespace stipple
