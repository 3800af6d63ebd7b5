#pragma once

#include "json_reader.hpp"
#include "names.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace stipple::proto {

// A field that may be absent, and then leaves what is there.

inline void take(JsonObject& object, const char* name, bool& out) {
    if (const auto value = object.find(name)) out = value->boolean();
}
inline void take(JsonObject& object, const char* name, double& out) {
    if (const auto value = object.find(name)) out = value->number();
}
inline void take(JsonObject& object, const char* name, std::optional<double>& out) {
    if (const auto value = object.find(name)) out = value->number();
}
inline void take(JsonObject& object, const char* name, unsigned& out) {
    if (const auto value = object.find(name)) out = value->small_integer();
}
inline void take(JsonObject& object, const char* name, std::uint64_t& out) {
    if (const auto value = object.find(name)) out = value->integer();
}
/// A count of something, at least 1.
inline void take(JsonObject& object, const char* name, std::optional<std::uint64_t>& out) {
    if (const auto value = object.find(name)) out = value->integer(1);
}
template <typename Enum, std::size_t N>
void take(JsonObject& object, const char* name, const std::array<Named<Enum>, N>& names,
          Enum& out) {
    if (const auto value = object.find(name)) out = one_of(names, *value);
}

template <typename Enum>
void take(JsonObject& object, const char* name, Enum (*from_name)(std::string_view), Enum& out) {
    if (const auto value = object.find(name)) out = value->named(from_name);
}

template <typename T>
void add(Json& json, const char* name, const std::optional<T>& value) {
    if (value) json[name] = *value;
}

}  // namespace stipple::proto
