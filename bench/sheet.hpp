#pragma once

#include "stipple/picture/sheet.hpp"

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

/// Small multiples: tiles of equal size in rows of `columns`, a caption under each, a legend at the
/// foot where there is one.
std::unique_ptr<Sheet> tiled(const std::vector<Tile>& tiles, unsigned columns,
                             const Legend* legend = nullptr);

/// As `.png`, or as `.webp` of that quality (0..100). @throws std::runtime_error.
void save(const Sheet& sheet, const std::filesystem::path& file, float quality = 82);

}  // namespace stipple::bench
