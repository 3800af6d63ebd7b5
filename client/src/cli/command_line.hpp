#pragma once

#include "stipple/proto/job.hpp"
#include "stipple/proto/slice.hpp"
#include "stipple/synthetic_scan.hpp"

#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

namespace stipple::cli {

/// What every command understands.
struct CommonOptions {
    std::string json;      ///< file for the figures, `-` for standard output, empty for none
    unsigned threads = 0;  ///< of a local run
    bool quiet = false;    ///< no progress, no summary
};

/// Where a job runs: here, when there is no address.
struct ServerOptions {
    std::string url;
    std::string api_key;
};

/// A cloud in, a cloud out.
template <typename Job>
struct FileCommand {
    std::filesystem::path input, output;
    Job job;
    PlyEncodeOptions ply;
    ServerOptions server;
    CommonOptions common;
};
using SimplifyCommand = FileCommand<proto::SimplifyJob>;
using UpsampleCommand = FileCommand<proto::UpsampleJob>;
struct AnalyzeCommand : FileCommand<proto::AnalyzeJob> {
    std::filesystem::path feature_lines;  ///< empty: none are sought
};

struct PyramidCommand {
    std::filesystem::path input, output_folder;
    proto::PyramidJob job;
    bool potree = false;  ///< the folder is one of Potree 2, and holds nothing else
    ServerOptions server;
    CommonOptions common;
};

struct SliceCommand {
    std::string pyramid;  ///< a folder; of a server the id of its job
    std::filesystem::path output;
    proto::SliceOptions options;
    ServerOptions server;
    CommonOptions common;
};

struct EvaluateCommand {
    std::filesystem::path reference;
    std::vector<std::filesystem::path> candidates;
    proto::EvaluateJob job;
    std::vector<std::filesystem::path> maps;  ///< each .ply or .drc (with -1, -2, ... before the
                                              ///< dot when there are several candidates) or .png
    ServerOptions server;
    CommonOptions common;
};

struct CurveCommand {
    std::filesystem::path input, plot;  ///< `plot` is empty when there is none
    proto::CurveJob job;
    ServerOptions server;
    CommonOptions common;
};

struct InspectCommand {
    std::filesystem::path input;
    CommonOptions common;
};

struct ConvertCommand {
    std::filesystem::path input, output;
    std::optional<std::uint64_t> points, bytes;  ///< of a progressive input: no more than the first
    DracoEncodeOptions draco;
    PlyEncodeOptions ply;
    CopcOptions copc;
    CommonOptions common;
};

struct SynthesizeCommand {
    std::filesystem::path output;
    SyntheticScanOptions options;
    DracoEncodeOptions draco;
    PlyEncodeOptions ply;
    CommonOptions common;
};

/// Help or the version, which was asked for and is all there is to do.
struct InfoCommand {
    std::string text;
};

using Command = std::variant<InfoCommand, SimplifyCommand, UpsampleCommand, AnalyzeCommand,
                             PyramidCommand, SliceCommand, CurveCommand, EvaluateCommand,
                             InspectCommand, ConvertCommand, SynthesizeCommand>;

/// The command line says something that cannot be done: exit code 2.
class UsageError : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/// Reads and checks the command line (and STIPPLE_API_KEY, when a server is named). Touches no
/// file. @throws UsageError.
Command parse_command_line(const std::vector<std::string>& arguments);

}  // namespace stipple::cli
