#include "codec/las_fields.hpp"

#include "base/in_quotes.hpp"
#include "cloud/attribute_name.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
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

/// The values of an attribute as those of a field; 0 for those that it cannot hold.
template <typename T>
struct Fitted {
    std::vector<T> values;
    std::size_t odd = 0;  ///< how many it cannot hold
};

template <typename T>
Fitted<T> fitted(const Attribute& attribute, auto&& fits) {
    return std::visit(
        [&](const auto& values) {
            Fitted<T> result{std::vector<T>(values.size())};
            for (std::size_t i = 0; i < values.size(); ++i) {
                const auto value = static_cast<double>(values[i]);
                if (fits(value))
                    result.values[i] = static_cast<T>(value);
                else
                    ++result.odd;
            }
            return result;
        },
        attribute.values);
}

template <typename T, T kMost = std::numeric_limits<T>::max()>
Fitted<T> whole_numbers(const Attribute& attribute) {
    return fitted<T>(attribute,
                     [](double v) { return v >= 0 && v <= kMost && v == std::trunc(v); });
}

Fitted<double> finite_numbers(const Attribute& attribute) {
    return fitted<double>(attribute, [](double v) { return std::isfinite(v); });
}

struct NamedFlag {
    std::string_view name;
    LasFlag bit;
};
constexpr std::array kFlags = {
    NamedFlag{"synthetic", kLasSynthetic},
    NamedFlag{"key_point", kLasKeyPoint},
    NamedFlag{"withheld", kLasWithheld},
    NamedFlag{"overlap", kLasOverlap},
    NamedFlag{"scan_direction_flag", kLasScanDirection},
    NamedFlag{"edge_of_flight_line", kLasEdgeOfFlightLine},
};

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
        auto [values, odd_points] = values_of(attribute);
        if (!admit(attribute.name, odd_points, values.size())) return false;
        field = std::move(values);
        return odd_points == 0;
    };
    return &attribute == return_number_ || &attribute == return_count_ ||
           take(intensities, "intensity", whole_numbers<std::uint16_t>) ||
           take(classifications, "classification", whole_numbers<std::uint8_t>) ||
           take(user_data, "user_data", whole_numbers<std::uint8_t>) ||
           take(sources, "point_source_id", whole_numbers<std::uint16_t>) ||
           take(times, "gps_time", finite_numbers) || take_flag(attribute);
}

bool LasFields::take_flag(const Attribute& attribute) {
    const auto flag = std::ranges::find_if(
        kFlags, [&](const NamedFlag& f) { return is_named(attribute, f.name); });
    if (flag == kFlags.end() || (flags_taken_ & flag->bit) != 0) return false;
    const auto [values, odd_points] = whole_numbers<std::uint8_t, 1>(attribute);
    if (!admit(attribute.name, odd_points, values.size())) return false;
    flags.resize(values.size());
    for (std::size_t i = 0; i < values.size(); ++i)
        if (values[i] != 0) flags[i] |= flag->bit;
    flags_taken_ |= flag->bit;
    return odd_points == 0;
}

/// Whether a field of LAS is to have the values of all points but some, and what is to be told of
/// these.
/// @param instead  what it has for them.
bool LasFields::admit(const std::string& name, std::size_t odd_points, std::size_t points,
                      std::string_view instead) {
    constexpr std::size_t kFew = 10;  // one of so many: of more it may be something else
    const bool admitted = kFew * odd_points <= points;
    if (odd_points == 0) return admitted;
    const std::string these = std::to_string(odd_points) + (odd_points == 1 ? " point" : " points");
    odd.push_back(
        name + (admitted ? ": " + std::string(instead) + " at " + these +
                               " whose values LAS's own field cannot hold; the extra bytes have all"
                         : ": in the extra bytes alone, since LAS's own field cannot hold the "
                           "values of " +
                               these));
    return admitted;
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
    const std::vector<std::uint8_t> numbers = whole_numbers<std::uint8_t>(*number).values,
                                    counts = whole_numbers<std::uint8_t>(*count).values;
    std::vector<LazReturn> all(numbers.size());
    std::size_t odd_points = 0;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        constexpr std::uint8_t kMost = 15;
        if (numbers[i] < 1 || numbers[i] > counts[i] || counts[i] > kMost)
            ++odd_points;
        else
            all[i] = {numbers[i], counts[i]};
    }
    if (!admit(number->name + " and " + count->name, odd_points, numbers.size(), "1 of 1")) return;
    returns = std::move(all);
    if (odd_points > 0) return;
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
    // By what readers call the fields of LAS that have values of this cloud; some as we do.
    const auto is_of_las = [&](std::string_view name) {
        const auto is_one_of = [name](std::initializer_list<std::string_view> names) {
            return std::ranges::find(names, name) != names.end();
        };
        const auto is = [name](std::string_view known) { return is_known_as(name, known); };
        return is_one_of({"X", "Y", "Z", "Red", "Green", "Blue"}) ||
               (!intensities.empty() && is("intensity")) ||
               (!classifications.empty() && is("classification")) ||
               (!user_data.empty() && is("user_data")) ||
               (!sources.empty() && is("point_source_id")) || (!times.empty() && is("gps_time")) ||
               (!returns.empty() && (is(kReturnNumber) || is(kReturnCount))) ||
               std::ranges::any_of(kFlags, [&](const NamedFlag& flag) {
                   return (flags_taken_ & flag.bit) != 0 && is(flag.name);
               });
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
