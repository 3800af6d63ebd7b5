#pragma once

#include <string>
#include <string_view>

namespace stipple::server {

/// A text as the value of a field of a log line: in quotes, so that what others wrote into it can
/// neither end the field nor the line.
std::string log_text(std::string_view text);

/// A name of one word, of letters, digits and `-_.@:`, as it is; any other as `log_text`; `-` for
/// none.
std::string log_name(std::string_view name);

}  // namespace stipple::server
