#include "stipple/proto/slice.hpp"
#include "cli/commands.hpp"
#include "cli/files.hpp"
#include "cli/job_execution.hpp"
#include "cli/report.hpp"
#include "cli/units.hpp"
#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/pyramid_export.hpp"

#include <chrono>
#include <cstddef>
#include <iostream>
#include <vector>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

/// From the folder of a pyramid.
proto::Slice slice_here(const SliceCommand& command, const Session& session) {
    const fs::path folder = command.pyramid;
    std::error_code none;
    if (!fs::is_directory(folder, none))
        throw Error(ErrorCode::NotFound,
                    folder.string() + ": no such folder; the id of a job needs --server");
    if (!fs::exists(folder / "manifest.json", none) && fs::exists(folder / "octree.bin", none))
        throw Error(ErrorCode::InvalidArgument,
                    folder.string() +
                        ": a Potree folder, which has no levels: expected one that `stipple "
                        "pyramid` writes without --layout potree");
    const proto::Results pyramid = read_manifest(folder);
    std::vector<fs::path> files;
    for (const proto::ExportFile& file : proto::export_files(pyramid))
        files.push_back(folder / file.name);
    require_apart(files, {command.output, command.common.json});
    proto::SliceOptions options = command.options;
    options.max_points = UINT32_MAX;  // both are limits of a server
    options.max_read_bytes = UINT64_MAX;
    const RunContext context = context_of(command.common, session);
    fs::path at = folder / "manifest.json";  // the file that is being read
    const auto read = [&](const proto::OutputFile& file) {
        // A manifest of foreign making names no file elsewhere.
        at = folder / fs::path(file.href).filename();
        std::vector<std::byte> bytes = read_file(at);
        if (proto::sha256_hex(bytes) != file.sha256)
            throw Error(ErrorCode::MalformedInput,
                        "not the file that manifest.json tells of: make the pyramid again");
        return bytes;
    };
    const auto cut = [&] {
        try {
            return proto::slice_pyramid(pyramid, options, read, context);
        } catch (const Error& error) {
            throw named_after(at, error);
        }
    };
    const proto::Slice slice = cut();
    write_text(command.output,
               {reinterpret_cast<const char*>(slice.bytes.data()), slice.bytes.size()});
    return slice;
}

proto::Slice slice_there(const SliceCommand& command, const Session& session) {
    Client client(command.server.url, {.api_key = command.server.api_key,
                                       .stop = session.stop,
                                       .timeout = std::chrono::seconds(120)});
    const ScratchFolder scratch(folder_of(command.output));
    const fs::path file = scratch.path() / "slice";
    proto::Slice slice =
        naming_key([&] { return client.slice(command.pyramid, command.options, file); });
    move_into_place(file, command.output);
    return slice;
}

}  // namespace

void run(const SliceCommand& command, const Session& session) {
    const auto start = std::chrono::steady_clock::now();
    require_files({}, {command.output, command.common.json});
    const bool here = command.server.url.empty();
    const proto::Slice slice = here ? slice_here(command, session) : slice_there(command, session);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    const std::uint64_t bytes = fs::file_size(command.output);
    if (!command.common.quiet) {
        const TextStyle& style = session.terminal.style();
        std::cerr << style.strong(counted(slice.points, "point")) << " of level " << slice.level
                  << " in " << readable_seconds(took.count()) << ' ' << style.dot() << ' '
                  << readable_bytes(bytes);
        if (slice.error_mean)
            std::cerr << ' ' << style.dot() << " error: mean at most "
                      << three_digits(*slice.error_mean) << ", max at least "
                      << three_digits(*slice.error_max);
        std::cerr << '\n';
    }
    ordered_json figures;
    figures["output"] = {{"points", slice.points},
                         {"file", command.output.string()},
                         {"bytes", bytes},
                         {"level", slice.level}};
    if (slice.error_mean)
        figures["error"] = {{"mean", *slice.error_mean}, {"max", *slice.error_max}};
    figures["seconds"] = {{"total", took.count()}};
    write_json(command.common.json, figures);
}

}  // namespace stipple::cli
