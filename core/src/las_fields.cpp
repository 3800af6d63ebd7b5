#include "las_fields.hpp"

#include "laz_chunk.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <bit>
#include <cctype>
#include <limits>
#include <string_view>
#include <type_traits>
#include <utility>

namespace stipple {

namespace {

template <typename T>
constexpr std::uint8_t las_type() {
    if constexpr (std::is_same_v<T, float>) return 9;
    if constexpr (std::is_same_v<T, double>) return 10;
    constexpr auto log_size = static_cast<std::uint8_t>(std::bit_width(sizeof(T)) - 1);
    return static_cast<std::uint8_t>(1 + 2 * log_size + (std::is_signed_v<T> ? 1 : 0));
}

template <typename T>
LasExtraField extra_field(std::string name, const T* first, std::size_t stride) {
    return {std::move(name), las_type<T>(), sizeof(T), stride,
            reinterpret_cast<const std::byte*>(first)};
}

/// In any case, and as CloudCompare names scalar fields.
bool is_named(const Attribute& attribute, std::string_view name) {
    std::string lower = attribute.name;
    std::ranges::transform(lower, lower.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    constexpr std::string_view kScalar = "scalar_";
    return lower == name || (lower.starts_with(kScalar) && lower.substr(kScalar.size()) == name);
}

/// The values of an attribute, where all are whole numbers that T can hold; else none.
template <typename T>
std::vector<T> whole_numbers(const Attribute& attribute) {
    return std::visit(
        [](const auto& values) {
            std::vector<T> numbers(values.size());
            for (std::size_t i = 0; i < values.size(); ++i) {
                const auto value = static_cast<double>(values[i]);
                const bool fits = value >= 0 && value <= std::numeric_limits<T>::max();
                numbers[i] = fits ? static_cast<T>(value) : T{};
                if (static_cast<double>(numbers[i]) != value) return std::vector<T>{};
            }
            return numbers;
        },
        attribute.values);
}

}  // namespace

LasFields::LasFields(const PointCloud& cloud) {
    for (int axis = 0; !cloud.normals.empty() && axis < 3; ++axis)
        add(extra_field(std::string("Normal") + "XYZ"[axis], cloud.normals.front().data() + axis,
                        sizeof(Vec3f)));
    if (!cloud.colors.empty() && cloud.has_alpha)
        add(extra_field("alpha", &cloud.colors.front().a, sizeof(Rgba8)));
    for (const Attribute& attribute : cloud.attributes)
        if (!take_as_known(attribute)) add(attribute);
    constexpr std::size_t kMost = 65'535 - kLazPointSize - kLazColorSize;
    if (extra_size > kMost)
        throw Error(ErrorCode::InvalidArgument,
                    "the attributes take " + std::to_string(extra_size) +
                        " bytes a point: LAS holds " + std::to_string(kMost));
}

bool LasFields::take_as_known(const Attribute& attribute) {
    if (attribute.components != 1) return false;
    if (intensities.empty() && is_named(attribute, "intensity"))
        return !(intensities = whole_numbers<std::uint16_t>(attribute)).empty();
    if (classifications.empty() && is_named(attribute, "classification"))
        return !(classifications = whole_numbers<std::uint8_t>(attribute)).empty();
    return false;
}

void LasFields::add(const Attribute& attribute) {
    for (unsigned c = 0; c < attribute.components; ++c) {
        const std::string name =
            attribute.components == 1 ? attribute.name : attribute.name + "_" + std::to_string(c);
        std::visit(
            [&](const auto& values) {
                add(extra_field(name, values.data() + c, attribute.components * sizeof(values[0])));
            },
            attribute.values);
    }
}

void LasFields::add(LasExtraField field) {
    extra_size += field.size;
    extras.push_back(std::move(field));
}

}  // namespace stipple
