#pragma once

#include "stipple/proto/results.hpp"

#include <string>
#include <vector>

namespace stipple::proto {

/// The name of a file of a job in a folder: `level-0.ply`; for a tile its hash, `<sha256>.glb`, as
/// in the tileset.
std::string file_name(const OutputCloud& level, const OutputFile& file);

/// One file of an exported pyramid: stored bytes, or text.
struct ExportFile {
    std::string name;
    const OutputFile* stored = nullptr;  ///< into the results; null: `text`
    std::string text{};
};

/// A finished pyramid as a folder that any static host can serve: its levels and tiles, its tileset
/// and its manifest, with references relative to the folder. The manifest comes last: without it,
/// nobody takes the folder as complete. Tiles with the same bytes are one file.
///
/// A service exports the same files as the command line writes.
std::vector<ExportFile> export_files(const Results& pyramid);

}  // namespace stipple::proto
