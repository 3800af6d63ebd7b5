#pragma once

#include "json_reader.hpp"

#include <algorithm>
#include <string>
#include <string_view>

namespace stipple::proto {

// Enumerators by their names on the wire: arrays of `Named`.

template <typename Enum>
struct Named {
    Enum value;
    std::string_view name;
};

template <typename Names, typename Enum>
std::string_view name_of(const Names& names, Enum value) noexcept {
    return std::ranges::find(names, value, &Named<Enum>::value)->name;
}

template <typename Names>
auto by_name(const Names& names, std::string_view name) {
    std::string offered;
    for (const auto& entry : names) {
        if (entry.name == name) return entry.value;
        offered += (offered.empty() ? "" : ", ") + std::string(entry.name);
    }
    throw Error(ErrorCode::InvalidArgument,
                "\"" + std::string(name.substr(0, 60)) + "\": expected one of " + offered);
}

template <typename Names>
auto one_of(const Names& names, const JsonValue& value) {
    return value.named([&names](std::string_view name) { return by_name(names, name); });
}

}  // namespace stipple::proto
