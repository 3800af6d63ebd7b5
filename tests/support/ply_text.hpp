#pragma once

#include "stipple/codec.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

// PLY files that stand in a test, and what is read of them.

namespace stipple::test {

inline std::span<const std::byte> bytes_of(std::string_view text) {
    return std::as_bytes(std::span(text.data(), text.size()));
}

inline PointCloud decode(std::string_view text, DecodeReport* report = nullptr,
                         unsigned threads = 0) {
    RunContext context;
    context.threads = threads;
    return decode_cloud(bytes_of(text), {}, context, report);
}

inline std::string text_of(const std::vector<std::byte>& bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

inline std::string ascii(std::string_view elements, std::string_view body) {
    return "ply\nformat ascii 1.0\n" + std::string(elements) + "end_header\n" + std::string(body);
}

inline const std::string kXyz = "property float x\nproperty float y\nproperty float z\n";
inline const std::string kOnePoint = ascii("element vertex 1\n" + kXyz, "0 0 0\n");
/// Of which only who reads the point finds that it is none.
inline const std::string kNoPoint = ascii("element vertex 1\n" + kXyz, "0 0 zero\n");

template <typename T>
void append(std::string& bytes, T value, bool big = false) {
    std::array<char, sizeof(T)> raw;
    std::memcpy(raw.data(), &value, sizeof(T));
    if (big) std::reverse(raw.begin(), raw.end());
    bytes.append(raw.data(), raw.size());
}

template <typename T>
const std::vector<T>& values(const PointCloud& cloud, std::string_view name) {
    const Attribute* const attribute = find_attribute(cloud, name);
    if (attribute == nullptr) throw std::runtime_error("no attribute " + std::string(name));
    return std::get<std::vector<T>>(attribute->values);
}

}  // namespace stipple::test
