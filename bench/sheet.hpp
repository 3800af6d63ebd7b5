#pragma once

#include "stipple/splat_renderer.hpp"

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace stipple::bench {

/// A picture with what is to be read under it.
struct Tile {
    Image image;
    std::string title;
    std::string note = {};  ///< smaller, under the title; empty: none
};

/// What the colours of a picture mean: viridis from `low` to `high`.
struct Legend {
    std::string title;  ///< with the unit
    double low = 0, high = 1;
    int decimals = 0;
};

enum class Align { Left, Center, Right };

/// White paper for pictures, captions and legends; lengths in pixels from the top left.
class Sheet {
public:
    Sheet(unsigned width, unsigned height);
    ~Sheet();
    Sheet(const Sheet&) = delete;
    Sheet& operator=(const Sheet&) = delete;

    void put(const Image& image, double x, double y);
    void text(const std::string& text, double x, double baseline, double size, Align align,
              bool bold = false);
    /// A bar of `width` with its two ends and its middle marked, 44 pixels high in all.
    void legend(const Legend& legend, double x, double y, double width);

    /// As `.png`, or as `.webp` of that quality (0..100). @throws std::runtime_error.
    void save(const std::filesystem::path& file, float quality = 82) const;

private:
    struct Surface;
    std::unique_ptr<Surface> surface_;
};

/// Small multiples: tiles of equal size in rows of `columns`, a caption under each, a legend at the
/// foot where there is one.
std::unique_ptr<Sheet> tiled(const std::vector<Tile>& tiles, unsigned columns,
                             const Legend* legend = nullptr);

}  // namespace stipple::bench
