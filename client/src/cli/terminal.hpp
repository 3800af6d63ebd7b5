#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace stipple::cli {

/// How text for people may look where it goes.
struct TextStyle {
    bool unicode = false;
    bool color = false;

    std::string_view arrow() const noexcept { return unicode ? "→" : "->"; }
    std::string_view plus_minus() const noexcept { return unicode ? "±" : "+-"; }
    std::string_view dot() const noexcept { return unicode ? "·" : "|"; }
    std::string dim(std::string_view text) const;
    std::string strong(std::string_view text) const;
    std::string bad(std::string_view text) const;
};

/// Whether the locale's character set is UTF-8, by LC_ALL, LC_CTYPE and LANG.
bool locale_is_utf8();

/// What stands behind standard error, where progress and summaries go, and behind standard output,
/// where answers do.
class Terminal {
public:
    Terminal();

    bool interactive() const noexcept { return interactive_; }
    const TextStyle& style() const noexcept { return style_; }
    const TextStyle& output_style() const noexcept { return output_style_; }
    /// Columns as of now; 80 when nobody knows.
    unsigned columns() const;
    /// Those behind standard output; without end where that is no terminal.
    std::size_t output_columns() const;

private:
    bool interactive_;
    TextStyle style_, output_style_;
};

/// Columns that `text` takes: one for each code point, none for colours.
unsigned display_width(std::string_view text) noexcept;
/// `scan_o…5k.ply`: the beginning and the end, where the text has more than so many columns.
std::string cut_amid(std::string_view text, std::size_t columns, bool unicode);
/// Lines of at most so many columns, as far as there are spaces to break the text at.
std::string wrapped(std::string_view text, unsigned columns);

}  // namespace stipple::cli
