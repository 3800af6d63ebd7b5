#include "codec/las_fields.hpp"

#include "base/in_quotes.hpp"
#include "cloud/attribute_name.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <initializer_list>
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

bool is_named(const Attribute& attribute, std::string_view name) {
    return attribute.components == 1 && is_known_as(attribute.name, name);
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

/// The values of an attribute, where all are finite; else none.
std::vector<double> finite_numbers(const Attribute& attribute) {
    return std::visit(
        [](const auto& values) {
            std::vector<double> numbers(values.begin(), values.end());
            const bool fits =
                std::ranges::all_of(numbers, [](double v) { return std::isfinite(v); });
            return fits ? numbers : std::vector<double>{};
        },
        attribute.values);
}

constexpr std::string_view kReturnNumber = "return_number", kReturnCount = "number_of_returns";

}  // namespace

LasFields::LasFields(const PointCloud& cloud) {
    take_returns(cloud);
    for (int axis = 0; !cloud.normals.empty() && axis < 3; ++axis)
        add(extra_field(std::string("Normal") + "XYZ"[axis], cloud.normals.front().data() + axis,
                        sizeof(Vec3f)));
    if (!cloud.colors.empty() && cloud.has_alpha)
        add(extra_field("alpha", &cloud.colors.front().a, sizeof(Rgba8)));
    // The known ones first: a name of theirs is free for an extra field only where they have none.
    std::vector<const Attribute*> others;
    for (const Attribute& attribute : cloud.attributes)
        if (!take_as_known(attribute)) others.push_back(&attribute);
    require_room(others);
    for (const Attribute* const attribute : others) add(*attribute);
}

/// Before each gets a name that no other has.
void LasFields::require_room(std::span<const Attribute* const> others) const {
    std::size_t all = extras.size();
    for (const Attribute* const attribute : others) all += attribute->components;
    if (all <= kMostExtraFields) return;
    const Attribute& widest = **std::ranges::max_element(others, {}, &Attribute::components);
    throw Error(ErrorCode::InvalidArgument,
                "attribute " + in_quotes(widest.name) + " has " +
                    std::to_string(widest.components) + " components, all together have " +
                    std::to_string(all) + ": a LAS file holds at most " +
                    std::to_string(kMostExtraFields) + " beside its own fields; leave some out");
}

bool LasFields::take_as_known(const Attribute& attribute) {
    const auto take = [&](auto& field, std::string_view name, auto&& values_of) {
        if (!field.empty() || !is_named(attribute, name)) return false;
        field = values_of(attribute);
        return !field.empty();
    };
    return &attribute == return_number_ || &attribute == return_count_ ||
           take(intensities, "intensity", whole_numbers<std::uint16_t>) ||
           take(classifications, "classification", whole_numbers<std::uint8_t>) ||
           take(user_data, "user_data", whole_numbers<std::uint8_t>) ||
           take(sources, "point_source_id", whole_numbers<std::uint16_t>) ||
           take(times, "gps_time", finite_numbers);
}

/// Where there are both numbers, and they make sense.
void LasFields::take_returns(const PointCloud& cloud) {
    const auto named = [&](std::string_view name) -> const Attribute* {
        const auto found = std::ranges::find_if(
            cloud.attributes, [&](const Attribute& a) { return is_named(a, name); });
        return found == cloud.attributes.end() ? nullptr : &*found;
    };
    const Attribute *const number = named(kReturnNumber), *const count = named(kReturnCount);
    if (number == nullptr || count == nullptr) return;
    const std::vector<std::uint8_t> numbers = whole_numbers<std::uint8_t>(*number),
                                    counts = whole_numbers<std::uint8_t>(*count);
    if (numbers.empty() || counts.empty()) return;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        constexpr std::uint8_t kMost = 15;
        if (numbers[i] < 1 || numbers[i] > counts[i] || counts[i] > kMost) {
            returns.clear();
            return;
        }
        returns.push_back({numbers[i], counts[i]});
    }
    return_number_ = number;
    return_count_ = count;
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
    constexpr std::size_t kLongest = 32;
    // By what readers call the fields of LAS that have values of this cloud.
    const auto is_of_las = [&](std::string_view name) {
        const auto is_one_of = [name](std::initializer_list<std::string_view> names) {
            return std::ranges::find(names, name) != names.end();
        };
        return is_one_of({"X", "Y", "Z", "Red", "Green", "Blue"}) ||
               (!intensities.empty() && name == "Intensity") ||
               (!classifications.empty() && name == "Classification") ||
               (!user_data.empty() && name == "UserData") ||
               (!sources.empty() && name == "PointSourceId") ||
               (!times.empty() && name == "GpsTime") ||
               (!returns.empty() && is_one_of({"ReturnNumber", "NumberOfReturns"}));
    };
    const auto is_taken = [&](std::string_view name) {
        return is_of_las(name) ||
               std::ranges::find(extras, name, &LasExtraField::name) != extras.end();
    };
    const std::string whole = field.name;
    field.name.resize(std::min(whole.size(), kLongest));
    for (unsigned n = 2; is_taken(field.name); ++n) {
        const std::string number = "_" + std::to_string(n);
        field.name = whole.substr(0, kLongest - number.size()) + number;
    }
    extra_size += field.size;
    extras.push_back(std::move(field));
}

}  // namespace stipple
