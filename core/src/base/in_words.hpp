#pragma once

#include <locale>
#include <sstream>
#include <string>

namespace stipple {

/// The parts one behind the other, as a stream writes them, whatever locale the program has.
template <typename... Parts>
std::string in_words(const Parts&... parts) {
    std::ostringstream text;
    text.imbue(std::locale::classic());
    (text << ... << parts);
    return text.str();
}

}  // namespace stipple
