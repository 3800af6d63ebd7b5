#pragma once

#include "stipple/proto/results.hpp"

#include <string>
#include <vector>

namespace stipple::proto {

/// The name of a file of a job in a folder: `level-0.ply`; of a tile its hash, `<sha256>.glb`, as
/// the tileset names it.
std::string file_name(const OutputCloud& level, const OutputFile& file);

/// One file of an exported pyramid: bytes that are stored, or text.
struct ExportFile {
    std::string name;
    const OutputFile* stored = nullptr;  ///< into the results; null: `text`
    std::string text{};
};

/// A finished pyramid as a folder that any static host can serve: its levels and tiles, its tileset
/// and its manifest, which name each other relative to the folder. The manifest is last: while it
/// is missing, nobody takes the folder for a whole. Tiles of the same bytes are one file.
///
/// The same files whether a service exports them or the command line writes them.
std::vector<ExportFile> export_files(const Results& pyramid);

}  // namespace stipple::proto
