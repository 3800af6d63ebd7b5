#pragma once

#include "stipple/point_cloud.hpp"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace stipple {

/// A field that LAS does not know: among the extra bytes of a point.
struct LasExtraField {
    std::string name;
    std::uint8_t type = 0;             ///< as LAS numbers types
    std::size_t size = 0, stride = 0;  ///< bytes: of a value; from one point to the next
    const std::byte* first = nullptr;  ///< the value of point 0 of the cloud
};

/// What a cloud has beside positions and colours, as the points of a LAS file have it; in the order
/// of the cloud, which must outlive it.
struct LasFields {
    std::vector<std::uint16_t> intensities;     ///< or empty
    std::vector<std::uint8_t> classifications;  ///< or empty
    std::vector<LasExtraField> extras;
    std::size_t extra_size = 0;  ///< bytes of all extras of a point

    /// @throws Error(InvalidArgument) for more extra bytes than a point can have.
    explicit LasFields(const PointCloud& cloud);

private:
    bool take_as_known(const Attribute& attribute);
    void add(const Attribute& attribute);
    void add(LasExtraField field);
};

}  // namespace stipple
