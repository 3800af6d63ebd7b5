// Written as text, not drawn by cairo as pictures of clouds are: cairo turns letters into outlines,
// which nobody can search, copy or edit.

#include "cli/curve_plot.hpp"

#include "cli/text.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <optional>
#include <vector>

namespace stipple::cli {
namespace {

using proto::CurveError;
using proto::OutputCloud;

// Names beside lines need room for the widest of the fonts that Helvetica may stand for.
constexpr double kWidth = 800, kHeight = 500;
constexpr double kLeft = 78, kRight = 176, kTop = 44, kBottom = 58;

// Variadic as in C, for then the compiler checks the format.
std::string formatted(const char* format, ...) __attribute__((format(printf, 1, 2)));
std::string formatted(const char* format, ...) {
    std::array<char, 512> text{};
    std::va_list arguments;
    va_start(arguments, format);
    std::vsnprintf(text.data(), text.size(), format, arguments);
    va_end(arguments);
    return text.data();
}

/// Fit for XML, which has no control characters, nor two that are none at all.
std::string escaped(const std::string& text) {
    std::string out;
    for (const char c : printable(text)) {
        if (c == '&')
            out += "&amp;";
        else if (c == '<')
            out += "&lt;";
        else if (c == '>')
            out += "&gt;";
        else
            out += c;
    }
    for (const std::string_view none : {"\xef\xbf\xbe", "\xef\xbf\xbf"})  // U+FFFE, U+FFFF
        for (auto at = out.find(none); at != out.npos; at = out.find(none))
            out.replace(at, none.size(), "\xef\xbf\xbd");
    return out;
}

/// A logarithmic axis on a line of the picture.
struct Axis {
    double low, high;  ///< values at its ends
    double from, to;   ///< where these are, in pixels

    double at(double value) const {
        return from + (to - from) * std::log(value / low) / std::log(high / low);
    }
    /// 1, 2 and 5 of each decade, or every decade where there are many.
    std::vector<double> ticks() const {
        const bool dense = high / low < 2e3;
        std::vector<double> ticks;
        for (double decade = std::pow(10, std::floor(std::log10(low))); decade <= high;
             decade *= 10) {
            for (const double step : {1.0, 2.0, 5.0}) {
                if (step > 1 && !dense) continue;
                const double tick = step * decade;
                if (tick >= low * 0.999 && tick <= high * 1.001) ticks.push_back(tick);
            }
        }
        return ticks;
    }
};

struct Line {
    const char* name;
    const char* color;
    const char* dash;
    double (*value)(const CurveError&);
};

// Dark to light, and dashes: told apart without colours, too.
constexpr std::array kLines = {
    Line{"maximum, from input", "#b2182b", "none",
         [](const CurveError& e) { return e.forward.max; }},
    Line{"maximum, from result", "#b2182b", "6 4",
         [](const CurveError& e) { return e.backward.max; }},
    Line{"rms, from input", "#d98c21", "none", [](const CurveError& e) { return e.forward.rms; }},
    Line{"rms, from result", "#d98c21", "6 4", [](const CurveError& e) { return e.backward.rms; }},
    Line{"mean, from input", "#2166ac", "none", [](const CurveError& e) { return e.forward.mean; }},
    Line{"mean, from result", "#2166ac", "6 4",
         [](const CurveError& e) { return e.backward.mean; }},
};

/// Percent of the diagonal; nothing where it is zero, which a logarithmic axis has not.
std::optional<double> percent(const Line& line, const OutputCloud& level) {
    const double diagonal = level.curve->diagonal;
    const double value = line.value(*level.curve);
    if (!(value > 0) || !(diagonal > 0)) return std::nullopt;
    return 100 * value / diagonal;
}

Axis error_axis(std::span<const OutputCloud> levels) {
    double low = 1e300, high = 0;
    for (const OutputCloud& level : levels) {
        for (const Line& line : kLines) {
            const auto value = percent(line, level);
            if (!value) continue;
            low = std::min(low, *value);
            high = std::max(high, *value);
        }
    }
    if (high == 0) low = 0.1, high = 1;
    return {low / 1.25, high * 1.25, kHeight - kBottom, kTop};
}

std::string text_at(double x, double y, const char* anchor, const std::string& text,
                    const char* more = "") {
    return formatted("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\"%s>", x, y, anchor, more) +
           escaped(text) + "</text>\n";
}

std::string straight(double x0, double y0, double x1, double y1, const char* style) {
    return formatted("<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" %s/>\n", x0, y0, x1, y1,
                     style);
}

/// `500`, `20k`, `1M`.
std::string short_count(double count) {
    if (count >= 1e6) return formatted("%.4gM", count / 1e6);
    if (count >= 1e3) return formatted("%.4gk", count / 1e3);
    return formatted("%.4g", count);
}

std::string grid(const Axis& x, const Axis& y) {
    constexpr const char* kGrid = "stroke=\"#dddddd\"";
    std::string svg;
    for (const double tick : x.ticks()) {
        svg += straight(x.at(tick), y.from, x.at(tick), y.to, kGrid);
        svg += text_at(x.at(tick), y.from + 18, "middle", short_count(tick));
    }
    for (const double tick : y.ticks()) {
        svg += straight(x.from, y.at(tick), x.to, y.at(tick), kGrid);
        svg += text_at(x.from - 8, y.at(tick) + 4, "end", formatted("%.4g", tick));
    }
    return svg + formatted(
                     "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" "
                     "fill=\"none\" stroke=\"#444444\"/>\n",
                     x.from, y.to, x.to - x.from, y.from - y.to);
}

std::string drawn(const Line& line, std::span<const OutputCloud> levels, const Axis& x,
                  const Axis& y) {
    std::string path, dots;
    for (const OutputCloud& level : levels) {
        const auto value = percent(line, level);
        if (!value) continue;
        const double at_x = x.at(static_cast<double>(level.points)), at_y = y.at(*value);
        path += formatted("%s%.1f %.1f", path.empty() ? "M" : " L", at_x, at_y);
        dots += formatted("<circle cx=\"%.1f\" cy=\"%.1f\" r=\"1.8\" fill=\"%s\"/>\n", at_x, at_y,
                          line.color);
    }
    return "<path d=\"" + path +
           formatted(
               "\" fill=\"none\" stroke=\"%s\" stroke-width=\"1.6\" "
               "stroke-dasharray=\"%s\"/>\n",
               line.color, line.dash) +
           dots;
}

std::string legend(double left) {
    std::string svg;
    double y = kTop + 8;
    for (const Line& line : kLines) {
        svg += formatted(
            "<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" "
            "stroke-width=\"1.6\" stroke-dasharray=\"%s\"/>\n",
            left, y, left + 22, y, line.color, line.dash);
        svg += text_at(left + 27, y + 4, "start", line.name, " font-size=\"11\"");
        y += 19;
    }
    return svg;
}

}  // namespace

std::string curve_plot(std::span<const OutputCloud> levels, const std::string& title) {
    const auto fewest = static_cast<double>(levels.front().points);
    const auto most = static_cast<double>(levels.back().points);
    const Axis x{fewest / 1.15, most * 1.15, kLeft, kWidth - kRight};
    const Axis y = error_axis(levels);
    std::string svg = formatted(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\" width=\"%.0f\" "
        "height=\"%.0f\" font-family=\"Helvetica, Arial, sans-serif\" font-size=\"12\" "
        "fill=\"#222222\">\n<rect width=\"100%%\" height=\"100%%\" fill=\"#ffffff\"/>\n",
        kWidth, kHeight, kWidth, kHeight);
    svg += text_at(kLeft, kTop - 16, "start", title, " font-size=\"14\" font-weight=\"bold\"");
    svg += grid(x, y);
    for (const Line& line : kLines) svg += drawn(line, levels, x, y);
    svg += legend(kWidth - kRight + 8);
    svg += text_at(0.5 * (x.from + x.to), kHeight - 16, "middle", "points");
    svg += formatted("<g transform=\"translate(20 %.1f) rotate(-90)\">", 0.5 * (y.from + y.to)) +
           text_at(0, 0, "middle", "distance, % of the diagonal") + "</g>\n";
    return svg + "</svg>\n";
}

}  // namespace stipple::cli
