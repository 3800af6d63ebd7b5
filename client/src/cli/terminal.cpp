#include "cli/terminal.hpp"

#include <sys/ioctl.h>
#include <unistd.h>
#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <vector>

namespace stipple::cli {
namespace {

std::string_view environment(const char* name) {
    const char* const value = std::getenv(name);
    return value == nullptr ? std::string_view() : value;
}

bool is_interactive(int descriptor) {
    return ::isatty(descriptor) == 1 && environment("TERM") != "dumb";
}

unsigned columns_of(int descriptor) {
    winsize size{};
    const bool known = ::ioctl(descriptor, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
    return known ? size.ws_col : 80;
}

std::string painted(bool color, std::string_view code, std::string_view text) {
    if (!color) return std::string(text);
    return "\033[" + std::string(code) + "m" + std::string(text) + "\033[0m";
}

}  // namespace

std::string TextStyle::dim(std::string_view text) const {
    return painted(color, "2", text);
}
std::string TextStyle::strong(std::string_view text) const {
    return painted(color, "1", text);
}
std::string TextStyle::bad(std::string_view text) const {
    return painted(color, "31", text);
}

bool locale_is_utf8() {
    std::string name;
    for (const char* variable : {"LC_ALL", "LC_CTYPE", "LANG"})
        if (name.empty()) name = environment(variable);
    std::transform(name.begin(), name.end(), name.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return name.find("utf-8") != name.npos || name.find("utf8") != name.npos;
}

Terminal::Terminal() : interactive_(is_interactive(STDERR_FILENO)) {
    const bool plain = !environment("NO_COLOR").empty();  // https://no-color.org
    style_ = {locale_is_utf8(), interactive_ && !plain};
    output_style_ = {style_.unicode, is_interactive(STDOUT_FILENO) && !plain};
}

unsigned Terminal::columns() const {
    return columns_of(STDERR_FILENO);
}

std::size_t Terminal::output_columns() const {
    return is_interactive(STDOUT_FILENO) ? columns_of(STDOUT_FILENO) : std::string::npos;
}

unsigned display_width(std::string_view text) noexcept {
    unsigned width = 0;
    bool escape = false;
    for (const char c : text) {
        if (c == '\033') escape = true;
        const bool continuation = (static_cast<unsigned char>(c) & 0xC0U) == 0x80U;
        if (!escape && !continuation) ++width;
        if (escape && c == 'm') escape = false;
    }
    return width;
}

std::string cut_amid(std::string_view text, std::size_t columns, bool unicode) {
    std::vector<std::size_t> begins;  // of characters
    for (std::size_t i = 0; i < text.size(); ++i)
        if ((static_cast<unsigned char>(text[i]) & 0xC0U) != 0x80U) begins.push_back(i);
    if (begins.size() <= columns) return std::string(text);
    const std::size_t kept = columns > 0 ? columns - 1 : 0, at_end = kept - kept / 2;
    const std::size_t tail = at_end > 0 ? begins[begins.size() - at_end] : text.size();
    return std::string(text.substr(0, begins[kept / 2])) + (unicode ? "…" : "~") +
           std::string(text.substr(tail));
}

std::string wrapped(std::string_view text, unsigned columns) {
    std::string lines;
    unsigned used = 0;
    for (std::size_t from = 0; from <= text.size();) {
        const std::size_t end = std::min(text.find(' ', from), text.size());
        const std::string_view word = text.substr(from, end - from);
        const bool fits = used + 1 + display_width(word) <= columns;
        if (from > 0) lines += fits ? ' ' : '\n';
        used = from > 0 && fits ? used + 1 + display_width(word) : display_width(word);
        lines += word;
        from = end + 1;
    }
    return lines;
}

}  // namespace stipple::cli
