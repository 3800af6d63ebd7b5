#pragma once

#include <charconv>
#include <cstdint>
#include <optional>
#include <string_view>

namespace stipple::proto {

/// The number of bytes in a size such as `14600`, `15kB`, `1.5 MiB`; with k, M, G or T, in any
/// case. Nothing if the text is not a size, or the size is negative or above 10^18.
///
/// @param format  of the number: whether `1e9` is allowed.
std::optional<std::uint64_t> bytes_of_size(std::string_view text,
                                           std::chars_format format = std::chars_format::general);

}  // namespace stipple::proto
