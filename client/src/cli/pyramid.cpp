#include "cli/bucket.hpp"
#include "cli/commands.hpp"
#include "cli/files.hpp"
#include "cli/job_execution.hpp"
#include "cli/report.hpp"
#include "cli/text.hpp"
#include "cli/units.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/potree.hpp"
#include "stipple/proto/pyramid_export.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <iostream>
#include <optional>
#include <ranges>
#include <set>
#include <span>
#include <vector>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr std::array kPotreeFiles = {"octree.bin", "hierarchy.bin", "metadata.json"};

/// The files of the pyramid that stands in a folder, if there is one.
/// @throws Error(InvalidArgument) where a manifest stands there that is none of a pyramid.
std::set<fs::path> pyramid_in(const fs::path& folder) {
    std::set<fs::path> files;
    std::error_code none;
    const auto is_there = [&](const char* name) { return fs::exists(folder / name, none); };
    if (std::ranges::all_of(kPotreeFiles, is_there))
        for (const char* const name : kPotreeFiles) files.insert(name);
    if (!is_there("manifest.json")) return files;
    try {
        const proto::Results pyramid = read_manifest(folder);
        for (const proto::ExportFile& file : proto::export_files(pyramid)) files.insert(file.name);
    } catch (const Error& error) {
        throw Error(ErrorCode::InvalidArgument,
                    std::string(error.what()) + ": no pyramid of this version is in " +
                        folder.string() + ": choose another folder, or remove the file");
    }
    return files;
}

/// Whether one of the files of the pyramid may get this name, as far as is known before the work.
bool may_be_of(const PyramidCommand& command, const std::string& name) {
    if (command.potree) return std::ranges::find(kPotreeFiles, name) != kPotreeFiles.end();
    if (name == "manifest.json") return true;
    if (name.starts_with("tileset") && name.ends_with(".json")) return true;
    const bool is_cloud = std::ranges::any_of(command.job.output.formats, [&](CloudFormat format) {
        return name.ends_with("." + std::string(to_string(format)));
    });
    return is_cloud &&
           (name.starts_with("level-") || proto::is_sha256(fs::path(name).stem().string()));
}

/// Before the work: no file of the pyramid takes the place of the input, of the figures or of a
/// folder. @param before  the files of the pyramid that stands there.
void require_own_places(const PyramidCommand& command, const fs::path& folder,
                        const std::set<fs::path>& before) {
    std::set<fs::path> names = before;
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(folder, none))
        if (may_be_of(command, entry.path().filename())) names.insert(entry.path().filename());
    const fs::path figures = without_links(command.common.json).filename();
    if (may_be_of(command, figures)) names.insert(figures);
    for (const fs::path& name : names) {
        const fs::path file = folder / name;
        require_apart({command.input}, {file});
        require_apart({}, {file, command.common.json});
        if (fs::is_directory(file, none))
            throw Error(ErrorCode::InvalidArgument,
                        file.string() +
                            ": it is a folder, but the pyramid has a file of this "
                            "name: remove it, or choose another folder");
    }
    require_apart({command.input}, {command.common.json});
}

/// @throws Error(InvalidArgument) for `https://example.org/x`, which would become a folder of that
/// name.
void require_no_address(const std::string& text) {
    const auto colon = text.find("://");
    if (colon == text.npos || text.find('/') < colon) return;
    throw Error(ErrorCode::InvalidArgument,
                text +
                    ": expected a folder, or s3://BUCKET/PREFIX with AWS_ENDPOINT_URL for a "
                    "store other than AWS");
}

/// The folder and those above it that are not there yet, the innermost first.
std::vector<fs::path> missing_folders(fs::path folder) {
    std::vector<fs::path> missing;
    std::error_code none;
    for (; fs::status(folder, none).type() == fs::file_type::not_found && !folder.empty();
         folder = folder.parent_path())
        missing.push_back(folder);
    return missing;
}

void make_folder(const fs::path& folder) {
    std::error_code error;
    fs::create_directories(folder, error);
    if (error || !fs::is_directory(folder))
        throw Error(ErrorCode::InvalidArgument, folder.string() + ": cannot create this folder" +
                                                    (error ? ": " + error.message() : ""));
}

/// All files are whole before the first takes its place, so that a full disk leaves what was there.
/// The manifest comes last: while it is missing or old, nobody takes the new files for a whole.
/// @returns their names, in this order.
std::vector<fs::path> publish(const proto::Results& results, const fs::path& scratch,
                              const PyramidCommand& command, const fs::path& folder) {
    const std::vector<proto::ExportFile> all = proto::export_files(results);
    std::vector<fs::path> sources;
    for (const proto::ExportFile& file : all) {
        // A server may name them as it likes.
        require_apart({command.input}, {folder / file.name});
        require_apart({}, {folder / file.name, command.common.json});
        sources.push_back(scratch / (file.stored ? file.stored->href : file.name));
        if (!file.stored) write_new_file(sources.back(), file.text, folder / file.name);
    }
    std::vector<fs::path> files;
    for (std::size_t i = 0; i < all.size(); ++i) {
        move_into_place(sources[i], folder / all[i].name);
        files.emplace_back(all[i].name);
    }
    return files;
}

/// The metadata last, as the manifest above. @returns their names, in this order.
std::vector<fs::path> publish_potree(const proto::Results& results, const fs::path& scratch,
                                     const fs::path& input, const fs::path& folder,
                                     const RunContext& context) {
    const PointCloud cloud =
        read_cloud(scratch / results.levels.at(0).files.at(0).href, limits_here(), context);
    proto::write_potree(cloud, scratch, {.name = printable(input.stem().string())}, context);
    for (const char* const name : kPotreeFiles) move_into_place(scratch / name, folder / name);
    return {kPotreeFiles.begin(), kPotreeFiles.end()};
}

BucketObject object_of(const fs::path& file, const fs::path& folder) {
    const std::string name = file.string(), extension = extension_of(file);
    std::string media_type = "application/octet-stream";
    if (extension == ".json") {
        media_type = "application/json";
    } else if (extension != ".bin") {
        const std::string format = extension == ".laz" ? "copc.laz" : extension.substr(1);
        media_type = stipple::media_type(cloud_format_from_name(format));
    }
    // The name of a tile is the hash of its bytes; other names may stand for other bytes one day.
    const bool never_changes = proto::is_sha256(file.stem().string());
    return {folder / file, name, media_type,
            never_changes ? "public, max-age=31536000, immutable" : "no-cache"};
}

/// What the folder holds, into a bucket, each file after those that it names: first tiles, then
/// tilesets, and the last file last.
void put(const BucketAddress& bucket, const BucketAccess& access, const fs::path& folder,
         std::span<const fs::path> files, const std::stop_token& stop, ProgressDisplay& display) {
    std::vector<BucketObject> objects;
    std::uint64_t all = 0, sent = 0;
    for (const fs::path& file : files) {
        objects.push_back(object_of(file, folder));
        all += fs::file_size(objects.back().file);
    }
    const auto on_bytes = [&](std::uint64_t bytes) {
        display.update("upload", static_cast<double>(sent + bytes) / static_cast<double>(all));
    };
    const auto last = std::prev(objects.end());
    const auto tilesets = std::stable_partition(objects.begin(), last, [](const BucketObject& o) {
        return o.media_type != "application/json";
    });
    const auto put_these = [&](auto begin, auto end) {
        put_objects(bucket, access, {begin, end}, on_bytes, stop);
        for (auto object = begin; object != end; ++object) sent += fs::file_size(object->file);
    };
    try {
        put_these(objects.begin(), tilesets);
        put_these(tilesets, last);
        put_these(last, objects.end());
    } catch (const Cancelled&) {
        throw PartlyPut();
    }
}

std::uint64_t bytes_of(const fs::path& folder, std::span<const fs::path> files) {
    std::uint64_t bytes = 0;
    for (const fs::path& file : files) bytes += fs::file_size(folder / file);
    return bytes;
}

std::uint64_t bytes_of(const proto::Results& results) {
    std::uint64_t bytes = 0;
    for (const proto::OutputCloud& level : results.levels)
        for (const proto::OutputFile& file : level.files) bytes += file.bytes;
    return bytes;
}

/// That of what is loaded: of the Draco file, else of the tiles, else of the points as they are,
/// where a file has them so. Of other formats nothing was measured.
std::optional<proto::FileError> loaded_error(const proto::OutputCloud& level) {
    for (const proto::OutputFile& file : level.files)
        if (file.error) return file.error;
    if (level.decoded) return proto::FileError{level.decoded->error.mean, level.decoded->error.max};
    const bool is_exact = std::ranges::find(level.files, CloudFormat::Ply,
                                            &proto::OutputFile::format) != level.files.end();
    if (!level.error || !is_exact) return std::nullopt;
    return proto::FileError{level.error->error.mean(), level.error->error.max()};
}

/// A row for each level: its points, the bytes of its files, its error.
std::string level_table(const proto::Results& results, const TextStyle& style) {
    constexpr std::size_t kGap = 2;
    std::vector<std::string> rows(results.levels.size() + 1);
    const auto add_column = [&](const std::string& title, auto&& text_of) {
        std::vector<std::string> cells = {title};
        for (const proto::OutputCloud& level : results.levels) cells.push_back(text_of(level));
        const std::size_t width = std::ranges::max(cells | std::views::transform(display_width));
        const std::size_t gap = rows.front().empty() ? 0 : kGap;
        for (std::size_t i = 0; i < rows.size(); ++i) rows[i] += in_right(cells[i], width + gap);
    };
    add_column("level", [](const auto& level) { return std::to_string(level.level); });
    add_column("points", [](const auto& level) { return with_separators(level.points); });
    std::set<CloudFormat> formats;
    for (const proto::OutputCloud& level : results.levels)
        for (const proto::OutputFile& file : level.files) formats.insert(file.format);
    for (const CloudFormat format : formats) {
        add_column(std::string(to_string(format)), [&](const proto::OutputCloud& level) {
            std::uint64_t bytes = 0;
            for (const proto::OutputFile& file : level.files)
                if (file.format == format) bytes += file.bytes;
            return bytes > 0 ? readable_bytes(bytes) : "";
        });
    }
    const bool is_known = std::ranges::any_of(
        results.levels, [](const auto& level) { return level.error && loaded_error(level); });
    if (is_known) {
        // Of a Draco file it is the error of its level and what rounding adds at most; the largest
        // is that at the samples which were measured.
        const bool bounded = formats.contains(CloudFormat::Draco);
        add_column(bounded ? "mean at most" : "mean error", [](const auto& level) {
            const auto error = loaded_error(level);
            return level.error && error ? distance_text(error->mean, level.error->error) : "";
        });
        add_column(style.unicode ? "max ≥" : "max >=", [](const auto& level) {
            const auto error = loaded_error(level);
            return level.error && error ? three_digits(error->max) : "";
        });
    }
    std::string text = style.dim(rows.front()) + "\n";
    for (std::size_t i = 1; i < rows.size(); ++i) text += rows[i] + "\n";
    return text;
}

void summarise(const PyramidCommand& command, const proto::Results& results, std::uint64_t bytes,
               double seconds, const Terminal& terminal) {
    const TextStyle& style = terminal.style();
    const std::string arrow = " " + std::string(style.arrow()) + " ";
    std::cerr << style.strong(counted(results.source->points, "point") + arrow +
                              counted(results.levels.size(), "level"))
              << " in " << readable_seconds(seconds) << ' ' << style.dot() << ' '
              << readable_bytes(fs::file_size(command.input)) << arrow << readable_bytes(bytes)
              << '\n';
    if (!command.potree) std::cerr << level_table(results, style);
    const std::string losses = losses_line(*results.source, style);
    if (!losses.empty()) std::cerr << style.dim(losses) << '\n';
}

ordered_json figures(const PyramidCommand& command, proto::Results results, std::uint64_t bytes) {
    for (proto::OutputCloud& level : results.levels) {
        if (command.potree) level.files.clear();  // of which its folder was made
        for (proto::OutputFile& file : level.files) file.href = proto::file_name(level, file);
    }
    ordered_json json;
    json["input"] = input_json(command.input, *results.source);
    json["input"]["sha256"] = results.request.input;
    json["output"] = {{"folder", command.output_folder.string()},
                      {"levels", ordered_json::parse(proto::to_json(results)).at("levels")},
                      {"bytes", bytes}};
    json["method"] = to_string(command.job.options.simplification.method);
    if (results.cost) add_cost(json, *results.cost);
    return json;
}

}  // namespace

void run(const PyramidCommand& command, const Session& session) {
    const auto start = std::chrono::steady_clock::now();
    const std::optional<BucketAddress> bucket = bucket_address(command.output_folder.string());
    if (!bucket) require_no_address(command.output_folder.string());
    require_input(command.input);
    // Into a bucket it goes from a folder that is gone in the end.
    std::optional<BucketAccess> access;
    std::optional<ScratchFolder> staging;
    if (bucket) {
        access = bucket_access([](const char* name) { return std::getenv(name); });
        require_bucket(*bucket, *access);
        staging.emplace(temporary_folder());
    }
    const fs::path folder = bucket ? staging->path() : command.output_folder;
    const std::vector<fs::path> made = missing_folders(folder);
    try {
        make_folder(folder);
        require_place_of(command.common.json);
        const std::set<fs::path> before = pyramid_in(folder);
        require_own_places(command, folder, before);
        const ScratchFolder scratch(folder);
        ProgressDisplay display(session.terminal, !command.common.quiet);
        const JobExecution execution{command.server, command.common.threads, session.stop};
        proto::Results results = naming(command.input, [&] {
            const proto::JobRequest request{proto::sha256_of_file(command.input), command.job};
            return execute(request, command.input, scratch.path(), execution, display);
        });
        if (!results.source || results.levels.empty())
            throw Error(ErrorCode::Internal, "the result of a pyramid job has no levels");
        raise_tile_errors(results);
        const RunContext context = context_of(command.common, session);
        const std::vector<fs::path> files =
            command.potree ? publish_potree(results, scratch.path(), command.input, folder, context)
                           : publish(results, scratch.path(), command, folder);
        const std::set<fs::path> kept(files.begin(), files.end());
        for (const fs::path& file : before)
            if (!kept.contains(file)) fs::remove(folder / file);
        const std::uint64_t bytes = command.potree ? bytes_of(folder, files) : bytes_of(results);
        if (bucket) put(*bucket, *access, folder, files, session.stop, display);
        display.finish();

        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
        if (!command.common.quiet)
            summarise(command, results, bytes, took.count(), session.terminal);
        write_json(command.common.json, figures(command, results, bytes));
    } catch (...) {
        std::error_code not_empty;
        for (const fs::path& empty : made) fs::remove(empty, not_empty);
        throw;
    }
}

}  // namespace stipple::cli
