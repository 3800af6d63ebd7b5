#include "stipple/proto/pyramid_export.hpp"

#include "stipple/proto/tiles.hpp"

#include <set>

namespace stipple::proto {

std::string file_name(const OutputCloud& level, const OutputFile& file) {
    const std::string stem = file.tile ? file.sha256 : "level-" + std::to_string(level.level);
    return stem + "." + std::string(to_string(file.format));
}

std::vector<ExportFile> export_files(const Results& pyramid) {
    std::vector<ExportFile> files;
    std::set<std::string> names;
    Results relative = pyramid;
    for (std::size_t i = 0; i < pyramid.levels.size(); ++i) {
        const OutputCloud& level = pyramid.levels[i];
        for (std::size_t j = 0; j < level.files.size(); ++j) {
            std::string name = file_name(level, level.files[j]);
            relative.levels[i].files[j].href = name;
            if (names.insert(name).second) files.push_back({std::move(name), &level.files[j]});
        }
    }
    for (TilesetFile& file : tileset_files(relative))
        files.push_back({std::move(file.name), nullptr, std::move(file.json) + '\n'});
    files.push_back({"manifest.json", nullptr, to_json(relative) + '\n'});
    return files;
}

}  // namespace stipple::proto
