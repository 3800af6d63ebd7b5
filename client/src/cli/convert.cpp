#include "cli/commands.hpp"
#include "cli/files.hpp"
#include "cli/job_execution.hpp"
#include "cli/progress_bar.hpp"
#include "cli/report.hpp"
#include "cli/text.hpp"
#include "cli/units.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "stipple/progressive_cloud.hpp"
#include "stipple/proto/digest.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <fstream>
#include <iostream>
#include <limits>
#include <optional>
#include <span>
#include <vector>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;
using Clock = std::chrono::steady_clock;

double seconds_between(Clock::time_point from, Clock::time_point to) {
    return std::chrono::duration<double>(to - from).count();
}

bool is_stream(const fs::path& file) {
    if (!fs::is_regular_file(file)) return false;  // of a pipe the first bytes would be gone
    std::array<char, 4> magic{};
    std::ifstream(file, std::ios::binary).read(magic.data(), magic.size());
    return detect_format(std::as_bytes(std::span(magic))) == CloudFormat::Progressive;
}

/// What a stream, which may have been cut, or its first bytes or points hold, without a look at the
/// rest of the file.
PointCloud read_stream(const ConvertCommand& command, const RunContext& context,
                       DecodeReport& report) {
    constexpr std::size_t kPiece = std::size_t{1} << 16U;
    constexpr auto kAll = std::numeric_limits<std::uint64_t>::max();
    std::ifstream file(command.input, std::ios::binary);
    ProgressiveDecoder decoder(limits_here(), command.points.value_or(kAll));
    std::vector<char> piece(kPiece);
    for (std::uint64_t left = command.bytes.value_or(kAll); left > 0 && !decoder.done();) {
        file.read(piece.data(),
                  static_cast<std::streamsize>(std::min<std::uint64_t>(left, kPiece)));
        const auto got = static_cast<std::size_t>(file.gcount());
        if (got == 0) break;
        decoder.feed(std::as_bytes(std::span(piece).first(got)), context);
        left -= got;
    }
    const bool cut_here = command.points || command.bytes;
    if (decoder.size() == 0)
        throw Error(cut_here ? ErrorCode::InvalidArgument : ErrorCode::MalformedInput,
                    cut_here ? "--bytes or --points do not reach the first point of the stream"
                             : "the stream ends before its first point");
    report = {.format = CloudFormat::Progressive,
              .encoding = "progressive",
              .points = decoder.total(),
              .faces = 0,
              .skipped = {},
              .comments = {}};
    return decoder.cloud(context);
}

PointCloud read_input(const ConvertCommand& command, const RunContext& context,
                      DecodeReport& report) {
    if (is_stream(command.input)) return read_stream(command, context, report);
    if (command.points || command.bytes)
        throw Error(ErrorCode::InvalidArgument,
                    command.input.string() +
                        ": not a progressive stream, which --points and --bytes need; "
                        "`stipple simplify` reduces any cloud");
    return read_cloud(command.input, limits_here(), context, &report);
}

/// For a file that holds finite positions alone. @returns how many points go.
std::uint64_t leave_out_non_finite(PointCloud& cloud) {
    std::vector<Index> finite;
    for (std::size_t i = 0; i < cloud.size(); ++i)
        if (cloud.positions[i].allFinite()) finite.push_back(static_cast<Index>(i));
    const std::uint64_t others = cloud.size() - finite.size();
    if (others > 0) cloud = subset(cloud, finite);
    return others;
}

/// Which no grid holds. @returns how many there were.
std::uint64_t zero_non_finite_normals(PointCloud& cloud) {
    std::uint64_t zeroed = 0;
    for (Vec3f& normal : cloud.normals) {
        if (normal.allFinite()) continue;
        normal = Vec3f::Zero();
        ++zeroed;
    }
    return zeroed;
}

ordered_json output_json(const fs::path& file, std::uint64_t points) {
    return {{"points", points},
            {"file", file.string()},
            {"bytes", fs::file_size(file)},
            {"sha256", proto::sha256_of_file(file)}};
}

}  // namespace

void run(const InfoCommand& command, const Session&) {
    write_out(command.text);
}

void run(const ConvertCommand& command, const Session& session) {
    require_files({command.input}, {command.output, command.common.json});
    const RunContext context = context_of(command.common, session);
    ProgressDisplay display(session.terminal, !command.common.quiet);
    DecodeReport report;
    const auto start = Clock::now();
    PointCloud cloud = naming(command.input, [&] {
        return read_input(command, display.stage("decode", 0, 0.5, context), report);
    });
    const auto decoded = Clock::now();
    const std::string extension = extension_of(command.output);
    const bool quantizes = extension == ".drc" || extension == ".stpc";
    const std::uint64_t zeroed = quantizes ? zero_non_finite_normals(cloud) : 0;
    proto::CloudStatistics losses;
    if (extension == ".stpc") {  // whose points are told apart by their places
        const CleaningReport removed = clean(cloud, context);
        losses.non_finite = removed.non_finite;
        losses.duplicates = removed.duplicates;
    } else if (extension != ".ply") {
        losses.non_finite = leave_out_non_finite(cloud);
    }
    losses.skipped = report.skipped;
    if (zeroed > 0)
        losses.skipped.push_back(counted(zeroed, "normal") + " that " +
                                 (zeroed == 1 ? "is" : "are") + " not finite");
    const std::uint64_t bytes_in = fs::file_size(command.input);
    PlyEncodeOptions ply = command.ply;
    ply.comments = report.comments;
    const Written written =
        write_cloud_into_place(cloud, command.output, ply, command.draco, command.copc,
                               display.stage("encode", 0.5, 1, context));
    const auto encoded = Clock::now();
    display.finish();

    const TextStyle& style = session.terminal.style();
    if (!command.common.quiet)
        std::cerr << summary_line({report.points, cloud.size(), bytes_in,
                                   fs::file_size(command.output), seconds_between(start, encoded)},
                                  style)
                  << '\n';
    if (const std::string lost = losses_line(losses, style); !command.common.quiet && !lost.empty())
        print_line(style.dim(lost), session.terminal);
    if (extension == ".drc" && !command.common.quiet)
        if (const std::string line = draco_line(cloud.origin, written.draco_step, style);
            !line.empty())
            print_line(style.dim(line), session.terminal);
    if (!command.common.quiet)
        for (const std::string& odd : written.odd_of_las)
            print_line(style.dim(printable(odd)), session.terminal);
    ordered_json figures;
    figures["input"] = {
        {"points", report.points},
        {"removed", {{"non_finite", losses.non_finite}, {"duplicates", losses.duplicates}}},
        {"file", command.input.string()},
        {"bytes", bytes_in},
        {"encoding", report.encoding},
        {"skipped", losses.skipped}};
    figures["output"] = output_json(command.output, cloud.size());
    if (!written.odd_of_las.empty()) figures["warnings"] = written.odd_of_las;
    figures["seconds"] = {{"decode", seconds_between(start, decoded)},
                          {"encode", seconds_between(decoded, encoded)},
                          {"total", seconds_between(start, encoded)}};
    write_json(command.common.json, figures);
}

void run(const SynthesizeCommand& command, const Session& session) {
    require_files({}, {command.output, command.common.json});
    const RunContext context = context_of(command.common, session);
    ProgressDisplay display(session.terminal, !command.common.quiet);
    const auto start = Clock::now();
    const PointCloud cloud =
        synthetic_scan(command.options, display.stage("sample", 0, 0.8, context));
    PlyEncodeOptions ply = command.ply;
    ply.comments.push_back("synthetic scan of an ammonite, seed " +
                           std::to_string(command.options.seed));
    write_cloud_into_place(cloud, command.output, ply, command.draco, {},
                           display.stage("encode", 0.8, 1, context));
    display.finish();

    const double seconds = seconds_between(start, Clock::now());
    if (!command.common.quiet)
        std::cerr << session.terminal.style().strong(counted(cloud.size(), "point")) << " in "
                  << readable_seconds(seconds) << ' ' << session.terminal.style().dot() << ' '
                  << readable_bytes(fs::file_size(command.output)) << '\n';
    ordered_json figures;
    figures["output"] = output_json(command.output, cloud.size());
    figures["seconds"] = {{"total", seconds}};
    write_json(command.common.json, figures);
}

}  // namespace stipple::cli
