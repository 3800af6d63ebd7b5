#include "stipple/picture/sheet.hpp"

#include "stipple/error.hpp"

#include <cairo.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>

namespace stipple {

namespace {

constexpr double kInk = 0.15;
constexpr unsigned kLargest = 32767;  // that cairo draws

std::string short_number(double value) {
    std::array<char, 64> text{};
    std::snprintf(text.data(), text.size(), "%.4g", value);
    return text.data();
}

void check(cairo_status_t status) {
    if (status == CAIRO_STATUS_SUCCESS) return;
    const auto code = status == CAIRO_STATUS_NO_MEMORY ? ErrorCode::TooLarge : ErrorCode::Internal;
    throw Error(code, std::string("picture: ") + cairo_status_to_string(status));
}

cairo_status_t append(void* bytes, const unsigned char* data, unsigned length) {
    auto& out = *static_cast<std::vector<std::byte>*>(bytes);
    const auto* begin = reinterpret_cast<const std::byte*>(data);
    try {
        out.insert(out.end(), begin, begin + length);
    } catch (...) {
        return CAIRO_STATUS_NO_MEMORY;
    }
    return CAIRO_STATUS_SUCCESS;
}

}  // namespace

struct Sheet::Surface {
    cairo_surface_t* pixels;
    cairo_t* pen;

    Surface(unsigned width, unsigned height)
        : pixels(cairo_image_surface_create(CAIRO_FORMAT_RGB24, static_cast<int>(width),
                                            static_cast<int>(height))),
          pen(cairo_create(pixels)) {}
    ~Surface() {
        cairo_destroy(pen);
        cairo_surface_destroy(pixels);
    }
    Surface(const Surface&) = delete;
    Surface& operator=(const Surface&) = delete;
};

Sheet::Sheet(unsigned width, unsigned height) {
    const unsigned side = std::max(width, height);
    if (std::min(width, height) == 0 || side > kLargest)
        throw Error(ErrorCode::InvalidArgument, "picture of " + std::to_string(width) + " x " +
                                                    std::to_string(height) + " pixels: at most " +
                                                    std::to_string(kLargest) + " a side");
    surface_ = std::make_unique<Surface>(width, height);
    check(cairo_status(surface_->pen));
    cairo_set_source_rgb(surface_->pen, 1, 1, 1);
    cairo_paint(surface_->pen);
}

Sheet::~Sheet() = default;

void Sheet::put(const Image& image, double x, double y) {
    const auto width = static_cast<int>(image.width), height = static_cast<int>(image.height);
    cairo_surface_t* picture = cairo_image_surface_create(CAIRO_FORMAT_ARGB32, width, height);
    if (cairo_surface_status(picture) == CAIRO_STATUS_SUCCESS) {
        cairo_surface_flush(picture);
        unsigned char* rows = cairo_image_surface_get_data(picture);
        const int stride = cairo_image_surface_get_stride(picture);
        for (unsigned row = 0; row < image.height; ++row) {
            auto* out = reinterpret_cast<std::uint32_t*>(rows + static_cast<int>(row) * stride);
            for (unsigned column = 0; column < image.width; ++column) {
                const Rgba8& p = image.at(column, row);
                const auto times_alpha = [&p](unsigned v) { return (v * p.a + 127U) / 255U; };
                *out++ = std::uint32_t{p.a} << 24 | times_alpha(p.r) << 16 | times_alpha(p.g) << 8 |
                         times_alpha(p.b);
            }
        }
        cairo_surface_mark_dirty(picture);
    }
    cairo_set_source_surface(surface_->pen, picture, x, y);
    cairo_paint(surface_->pen);
    cairo_surface_destroy(picture);
    check(cairo_status(surface_->pen));
}

void Sheet::text(const std::string& text, double x, double baseline, double size, Align align,
                 bool bold, double width) {
    cairo_t* pen = surface_->pen;
    cairo_save(pen);
    cairo_select_font_face(pen, "DejaVu Sans", CAIRO_FONT_SLANT_NORMAL,
                           bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(pen, size);
    cairo_text_extents_t extents;
    cairo_text_extents(pen, text.c_str(), &extents);
    double length = extents.x_advance;
    if (width > 0 && length > width) length = width;
    const double before = align == Align::Left ? 0 : align == Align::Center ? 0.5 * length : length;
    if (width > 0) {
        cairo_rectangle(pen, x - before, baseline - 2 * size, length + 1, 3 * size);
        cairo_clip(pen);
    }
    cairo_set_source_rgb(pen, kInk, kInk, kInk);
    cairo_move_to(pen, x - before, baseline);
    cairo_show_text(pen, text.c_str());
    cairo_restore(pen);
    check(cairo_status(pen));
}

void Sheet::legend(const Legend& legend, double x, double y, double width) {
    constexpr double kBar = 14, kSize = 13, kTick = 4;
    constexpr int kParts = 4;
    cairo_t* pen = surface_->pen;
    const auto steps = static_cast<int>(width);
    for (int i = 0; i < steps; ++i) {
        const Rgba8 c = viridis((i + 0.5) / steps);
        cairo_set_source_rgb(pen, c.r / 255.0, c.g / 255.0, c.b / 255.0);
        cairo_rectangle(pen, std::floor(x) + i, y, 1, kBar);
        cairo_fill(pen);
    }
    const double baseline = y + kBar + kTick + kSize;
    for (int i = 0; i <= kParts; ++i) {
        const double t = static_cast<double>(i) / kParts, at = std::floor(x + t * width);
        cairo_set_source_rgb(pen, kInk, kInk, kInk);
        cairo_rectangle(pen, at, y + kBar, 1, kTick);
        cairo_fill(pen);
        const std::string number = short_number(legend.low + t * (legend.high - legend.low));
        text((i == kParts ? "≥ " : "") + number, at, baseline, kSize, Align::Center);
    }
    text(legend.title, x + 0.5 * width, baseline + kSize + 6, kSize, Align::Center);
}

Image Sheet::image() const {
    cairo_surface_t* const pixels = surface_->pixels;
    cairo_surface_flush(pixels);
    Image image{static_cast<unsigned>(cairo_image_surface_get_width(pixels)),
                static_cast<unsigned>(cairo_image_surface_get_height(pixels)),
                {}};
    image.pixels.reserve(std::size_t{image.width} * image.height);
    const unsigned char* rows = cairo_image_surface_get_data(pixels);
    const int stride = cairo_image_surface_get_stride(pixels);
    for (unsigned row = 0; row < image.height; ++row) {
        const auto* in =
            reinterpret_cast<const std::uint32_t*>(rows + static_cast<int>(row) * stride);
        for (unsigned column = 0; column < image.width; ++column) {
            const std::uint32_t p = in[column];
            image.pixels.push_back({static_cast<std::uint8_t>(p >> 16U),
                                    static_cast<std::uint8_t>(p >> 8U),
                                    static_cast<std::uint8_t>(p), 255});
        }
    }
    return image;
}

std::vector<std::byte> Sheet::png() const {
    std::vector<std::byte> bytes;
    cairo_surface_flush(surface_->pixels);
    check(cairo_surface_write_to_png_stream(surface_->pixels, append, &bytes));
    return bytes;
}

}  // namespace stipple
