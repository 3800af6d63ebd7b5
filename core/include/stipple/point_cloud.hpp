#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace stipple {

using Index = std::uint32_t;  ///< numbers the points of a cloud: fewer than 2^32 of them
using Vec3f = Eigen::Vector3f;
using Vec3d = Eigen::Vector3d;

/// A colour as stored and shown: sRGB, 8 bits per channel. Averages are taken in linear light.
struct Rgba8 {
    std::uint8_t r = 0, g = 0, b = 0, a = 255;
    friend bool operator==(const Rgba8&, const Rgba8&) = default;
};

/// How the values of many points become the value of one.
enum class Reduction {
    Mean,     ///< the average, ignoring NaN; the default for floating-point values
    Nearest,  ///< the value of the point nearest to the new one; the default for integers, which
              ///< may be labels
    Min,
    Max,
    Mode,  ///< the most frequent value; the smallest in a tie
};

/// The values of an attribute, in the type they had in the file.
using AttributeValues =
    std::variant<std::vector<std::int8_t>, std::vector<std::uint8_t>, std::vector<std::int16_t>,
                 std::vector<std::uint16_t>, std::vector<std::int32_t>, std::vector<std::uint32_t>,
                 std::vector<float>, std::vector<double>>;

/// Any per-point property that is not a position, normal or colour.
struct Attribute {
    std::string name;        ///< as in the file: 1 to 255 printable ASCII characters without spaces
    AttributeValues values;  ///< N * components values, point by point
    unsigned components = 1;  ///< values per point
    Reduction reduction = Reduction::Nearest;

    std::size_t value_count() const noexcept {
        return std::visit([](const auto& v) { return v.size(); }, values);
    }
};

/// `Mean` for floating-point values, `Nearest` for integers.
Reduction default_reduction(const AttributeValues& values) noexcept;

/// Axis-aligned box. Empty (min > max) until something is added.
struct Aabb {
    Vec3d min = Vec3d::Constant(std::numeric_limits<double>::infinity());
    Vec3d max = Vec3d::Constant(-std::numeric_limits<double>::infinity());

    bool empty() const noexcept { return !(min.array() <= max.array()).all(); }
    double diagonal() const noexcept { return empty() ? 0.0 : (max - min).norm(); }
};

/// Points and their attributes: one array per attribute, each empty (absent) or with N entries.
/// Lengths are squared in single precision, so computations on a cloud less than 1e-15 or more than
/// 1e15 across are meaningless.
struct PointCloud {
    Vec3d origin =
        Vec3d::Zero();  ///< added to every position; keeps georeferenced doubles exact enough
    std::vector<Vec3f> positions;  ///< N, in the unit of the input, relative to origin
    std::vector<Vec3f> normals;    ///< N unit vectors, or empty
    std::vector<Rgba8> colors;     ///< N, sRGB, or empty
    bool has_alpha = false;        ///< whether the alpha of `colors` is meaningful
    bool double_precision =
        false;  ///< whether positions were read as doubles, and are written as such
    std::vector<Attribute> attributes;

    std::size_t size() const noexcept { return positions.size(); }
    bool empty() const noexcept { return positions.empty(); }
};

/// Checks that every array has N entries or none, and that the origin is finite.
/// @throws Error(InvalidArgument) naming the array that does not.
void validate(const PointCloud& cloud);

/// Checks that single precision can hold the squares of a cloud's lengths.
/// @param diagonal  of its box; may be 0.
/// @throws Error(MalformedInput) below 1e-15 or above 1e15.
void require_squares(double diagonal);

/// Checks what computations rely on, as `clean` leaves it: `validate`, and that all positions are
/// finite. O(N).
/// @throws Error(InvalidArgument) naming what is wrong.
void require_cleaned(const PointCloud& cloud);

/// Bounds of the finite positions, in the unit of the input, origin added. O(N).
Aabb bounds(const PointCloud& cloud);

/// The middle of the box in which nine of ten of some thousand points lie along each axis, origin
/// added: strays do not move it. Of a cloud with finite positions; zero where there are none.
Vec3d middle_of_most(const PointCloud& cloud);

/// The points of `cloud` at `indices`, in that order, with all their attributes. O(indices).
PointCloud subset(const PointCloud& cloud, std::span<const Index> indices);

/// The attribute of that name, or null.
const Attribute* find_attribute(const PointCloud& cloud, std::string_view name) noexcept;

/// Adds an attribute, replacing any attribute of the same name.
void set_attribute(PointCloud& cloud, Attribute attribute);

}  // namespace stipple
