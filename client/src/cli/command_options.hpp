#pragma once

#include "cli/commands.hpp"
#include "cli/method_options.hpp"

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stipple::cli {

/// What the options are read into before they are checked and mean something.
struct Values {
    std::string input, output, method{to_string(SimplifyOptions{}.method)};
    std::optional<std::uint64_t> points;
    std::optional<std::uint64_t> bytes;
    std::optional<double> ratio, precision;
    std::vector<double> box;
    std::string max_error, plot;
    std::vector<std::uint64_t> curve_points;
    unsigned curve_count = ErrorCurveOptions{}.count;
    std::uint64_t seed = 0;
    MethodValues of_methods;
    std::string splats = "radius", orient = "mst", viewpoint, feature_lines;
    FeatureLineOptions features;
    bool source_index = false;
    SurfaceAttributeOptions surface;
    std::vector<std::string> reductions, formats = {"drc", "ply", "glb"};
    std::optional<std::uint64_t> first_points, first_bytes;
    std::vector<std::uint64_t> levels;
    bool no_error = false;
    std::vector<std::string> candidates, maps;
    proto::EvaluationOptions evaluation;
    std::string sampling = "points", basis, up = "y";
    LodPyramidOptions pyramid;
    LodTileOptions tiles;
    std::vector<double> transform;
    std::optional<unsigned> epsg;
    std::string layout = "levels";
    std::optional<std::uint64_t> base_bytes;
    std::string refine = "replace";
    std::string pyramid_method{to_string(LodPyramidOptions{}.simplification.method)};
    SyntheticScanOptions synthetic;
    DracoEncodeOptions draco;
    std::string coding = "auto", ply_encoding = "le";
    ServerOptions server;
    bool has_server = false;  ///< it may be empty
    CommonOptions common;
};

/// What a file that `convert` writes may end with.
inline constexpr std::string_view kConvertEndings = ".ply, .drc, .stpc or .laz";

// What each command takes, and what its help says.

CLI::App& add_simplify(CLI::App& app, Values& values);
CLI::App& add_upsample(CLI::App& app, Values& values);
CLI::App& add_analyze(CLI::App& app, Values& values);
CLI::App& add_pyramid(CLI::App& app, Values& values);
CLI::App& add_slice(CLI::App& app, Values& values);
CLI::App& add_evaluate(CLI::App& app, Values& values);
CLI::App& add_curve(CLI::App& app, Values& values);
CLI::App& add_inspect(CLI::App& app, Values& values);
CLI::App& add_convert(CLI::App& app, Values& values);
CLI::App& add_synthesize(CLI::App& app, Values& values);

}  // namespace stipple::cli
