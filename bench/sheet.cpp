#include "sheet.hpp"

#include <cairo.h>
#include <webp/encode.h>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>
#include <stdexcept>

namespace stipple::bench {

namespace {

constexpr double kCaption = 46, kGap = 14, kLegendHeight = 64;  // pixels
constexpr double kInk = 0.15;

std::string fixed(double value, int decimals) {
    char text[64];
    std::snprintf(text, sizeof text, "%.*f", decimals, value);
    return text;
}

}  // namespace

struct Sheet::Surface {
    cairo_surface_t* pixels;
    cairo_t* pen;

    Surface(unsigned width, unsigned height)
        : pixels(cairo_image_surface_create(CAIRO_FORMAT_RGB24, static_cast<int>(width),
                                            static_cast<int>(height))),
          pen(cairo_create(pixels)) {
        if (cairo_status(pen) != CAIRO_STATUS_SUCCESS)
            throw std::runtime_error(cairo_status_to_string(cairo_status(pen)));
    }
    ~Surface() {
        cairo_destroy(pen);
        cairo_surface_destroy(pixels);
    }
    Surface(const Surface&) = delete;
    Surface& operator=(const Surface&) = delete;
};

Sheet::Sheet(unsigned width, unsigned height) : surface_(std::make_unique<Surface>(width, height)) {
    cairo_set_source_rgb(surface_->pen, 1, 1, 1);
    cairo_paint(surface_->pen);
}

Sheet::~Sheet() = default;

void Sheet::put(const Image& image, double x, double y) {
    const auto width = static_cast<int>(image.width), height = static_cast<int>(image.height);
    cairo_surface_t* picture = cairo_image_surface_create(CAIRO_FORMAT_ARGB32, width, height);
    cairo_surface_flush(picture);
    unsigned char* rows = cairo_image_surface_get_data(picture);
    const int stride = cairo_image_surface_get_stride(picture);
    for (unsigned row = 0; row < image.height; ++row) {
        auto* out = reinterpret_cast<std::uint32_t*>(rows + static_cast<int>(row) * stride);
        for (unsigned column = 0; column < image.width; ++column) {
            const Rgba8& p = image.at(column, row);
            const auto times_alpha = [&](unsigned v) { return (v * p.a + 127U) / 255U; };
            *out++ = std::uint32_t{p.a} << 24 | times_alpha(p.r) << 16 | times_alpha(p.g) << 8 |
                     times_alpha(p.b);
        }
    }
    cairo_surface_mark_dirty(picture);
    cairo_set_source_surface(surface_->pen, picture, x, y);
    cairo_paint(surface_->pen);
    cairo_surface_destroy(picture);
}

void Sheet::text(const std::string& text, double x, double baseline, double size, Align align,
                 bool bold) {
    cairo_t* pen = surface_->pen;
    cairo_select_font_face(pen, "DejaVu Sans", CAIRO_FONT_SLANT_NORMAL,
                           bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(pen, size);
    cairo_text_extents_t extents;
    cairo_text_extents(pen, text.c_str(), &extents);
    const double before = align == Align::Left     ? 0
                          : align == Align::Center ? 0.5 * extents.x_advance
                                                   : extents.x_advance;
    cairo_set_source_rgb(pen, kInk, kInk, kInk);
    cairo_move_to(pen, x - before, baseline);
    cairo_show_text(pen, text.c_str());
}

void Sheet::legend(const Legend& legend, double x, double y, double width) {
    constexpr double kBar = 12, kSize = 12;
    cairo_t* pen = surface_->pen;
    const auto steps = static_cast<int>(width);
    for (int i = 0; i < steps; ++i) {
        const Rgba8 c = viridis((i + 0.5) / steps);
        cairo_set_source_rgb(pen, c.r / 255.0, c.g / 255.0, c.b / 255.0);
        cairo_rectangle(pen, std::floor(x) + i, y, 1, kBar);
        cairo_fill(pen);
    }
    const double baseline = y + kBar + kSize + 3;
    const double middle = 0.5 * (legend.low + legend.high);
    text(fixed(legend.low, legend.decimals), x, baseline, kSize, Align::Center);
    text(fixed(middle, legend.decimals), x + 0.5 * width, baseline, kSize, Align::Center);
    text("≥ " + fixed(legend.high, legend.decimals), x + width, baseline, kSize, Align::Center);
    text(legend.title, x + 0.5 * width, baseline + kSize + 5, kSize, Align::Center);
}

void Sheet::save(const std::filesystem::path& file, float quality) const {
    cairo_surface_t* pixels = surface_->pixels;
    cairo_surface_flush(pixels);
    if (file.extension() == ".png") {
        if (cairo_surface_write_to_png(pixels, file.c_str()) != CAIRO_STATUS_SUCCESS)
            throw std::runtime_error("cannot write " + file.string());
        return;
    }
    std::uint8_t* bytes = nullptr;  // cairo's words are blue, green, red, nothing in memory
    const std::size_t size =
        WebPEncodeBGRA(cairo_image_surface_get_data(pixels), cairo_image_surface_get_width(pixels),
                       cairo_image_surface_get_height(pixels),
                       cairo_image_surface_get_stride(pixels), quality, &bytes);
    const std::unique_ptr<std::uint8_t, void (*)(void*)> owner(bytes, WebPFree);
    std::ofstream out(file, std::ios::binary);
    out.write(reinterpret_cast<const char*>(bytes), static_cast<std::streamsize>(size));
    if (size == 0 || !out.flush()) throw std::runtime_error("cannot write " + file.string());
}

std::unique_ptr<Sheet> tiled(const std::vector<Tile>& tiles, unsigned columns,
                             const Legend* legend) {
    const double width = tiles.front().image.width, height = tiles.front().image.height;
    const auto rows = static_cast<unsigned>((tiles.size() + columns - 1) / columns);
    const double all = columns * (width + kGap) + kGap;
    const double down = rows * (height + kCaption) + kGap;
    auto sheet = std::make_unique<Sheet>(
        static_cast<unsigned>(all),
        static_cast<unsigned>(down + (legend != nullptr ? kLegendHeight : 0)));
    for (std::size_t i = 0; i < tiles.size(); ++i) {
        const double x = kGap + static_cast<double>(i % columns) * (width + kGap);
        const double y = kGap + static_cast<double>(i / columns) * (height + kCaption);
        const Tile& tile = tiles[i];
        sheet->put(tile.image, x, y);
        sheet->text(tile.title, x + 0.5 * width, y + height + 14, 15, Align::Center, true);
        sheet->text(tile.note, x + 0.5 * width, y + height + 31, 12, Align::Center);
    }
    if (legend != nullptr) {
        const double bar = std::min(420.0, 0.6 * all);
        sheet->legend(*legend, 0.5 * (all - bar), down, bar);
    }
    return sheet;
}

}  // namespace stipple::bench
