#include "sheet.hpp"

#include <webp/encode.h>
#include <algorithm>
#include <cstdint>
#include <fstream>
#include <stdexcept>

namespace stipple::bench {

namespace {

constexpr double kCaption = 46, kGap = 14, kLegendHeight = 64;  // pixels

}  // namespace

void save(const Sheet& sheet, const std::filesystem::path& file, float quality) {
    std::ofstream out(file, std::ios::binary);
    if (file.extension() == ".png") {
        const std::vector<std::byte> png = sheet.png();
        out.write(reinterpret_cast<const char*>(png.data()),
                  static_cast<std::streamsize>(png.size()));
    } else {
        const Image image = sheet.image();
        std::uint8_t* bytes = nullptr;
        const std::size_t size =
            WebPEncodeRGBA(reinterpret_cast<const std::uint8_t*>(image.pixels.data()),
                           static_cast<int>(image.width), static_cast<int>(image.height),
                           static_cast<int>(image.width * sizeof(Rgba8)), quality, &bytes);
        const std::unique_ptr<std::uint8_t, void (*)(void*)> owner(bytes, WebPFree);
        out.write(reinterpret_cast<const char*>(bytes), static_cast<std::streamsize>(size));
    }
    if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
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
