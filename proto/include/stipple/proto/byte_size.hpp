#pragma once

#include <charconv>
#include <cstdint>
#include <optional>
#include <string_view>

namespace stipple::proto {

/// Whole bytes of a size as people write it: `14600`, `15kB`, `1.5 MiB`; of k, M, G and T, in any
/// case. Nothing where the text is none, or the size is negative or above 10^18.
///
/// @param format  of the number: whether `1e9` is one.
std::optional<std::uint64_t> bytes_of_size(std::string_view text,
                                           std::chars_format format = std::chars_format::general);

}  // namespace stipple::proto
