#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace stipple::cli {

/// Text of a file, of a name or of a server, fit for a line of a terminal, a picture or a page:
/// U+FFFD for each part that is no UTF-8, a space for each control character. Those of a terminal
/// (C0, DEL and C1) would else move its cursor, colour what follows or set its title.
std::string printable(std::string_view text);

/// The beginning of UTF-8 text in so many bytes, without a part of a character at its end.
std::string shortened(std::string text, std::size_t most_bytes);

}  // namespace stipple::cli
