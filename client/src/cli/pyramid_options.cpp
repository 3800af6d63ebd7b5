#include "cli/command_options.hpp"
#include "cli/method_options.hpp"
#include "cli/numbers.hpp"
#include "cli/shared_options.hpp"
#include "stipple/globe.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <iterator>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace stipple::cli {
namespace {

struct Values {
    std::string input, output, layout = "levels", refine = "replace";
    std::vector<std::uint64_t> levels;
    LodPyramidOptions pyramid;
    std::optional<std::uint64_t> base_bytes;
    std::string method{to_string(LodPyramidOptions{}.simplification.method)};
    std::uint64_t seed = 0;
    std::vector<std::string> reductions, formats = {"drc", "ply", "glb"};
    LodTileOptions tiles;
    std::vector<double> transform;
    std::optional<unsigned> epsg;
    bool no_error = false;
    std::optional<double> outliers;
    EncodingValues encoding;
    ServerValues server;
    CommonOptions common;
    MethodValues of_methods;
};

/// Potree's octree is made of the cloud itself: a pyramid of one level.
PyramidCommand potree_command(PyramidCommand command, const CLI::App& app) {
    for (const CLI::Option* const option : app.get_options()) {
        const std::string name = option->get_name();
        constexpr std::array kTaken = {"--layout",  "--remove-outliers", "--server",
                                       "--api-key", "--threads",         "--json",
                                       "--quiet"};
        const bool taken = std::ranges::find(kTaken, name) != kTaken.end();
        if (name.starts_with("--") && option->count() > 0 && !taken)
            throw UsageError(name + " cannot be combined with --layout potree");
    }
    command.job.options.sizes = {UINT32_MAX};
    command.job.output.formats = {CloudFormat::Ply};
    command.job.error = false;
    return command;
}

/// @throws UsageError for an option that no format of the pyramid takes.
void require_options_of_levels(const CLI::App& app, const std::vector<std::string>& formats) {
    static const std::array kOptions = {
        FormatOption{"--position-bits", {"drc"}},
        FormatOption{"--normal-bits", {"drc"}},
        FormatOption{"--attribute-bits", {"drc"}},
        FormatOption{"--coding", {"drc"}},
        FormatOption{"--precision", {"drc", "glb", "stpc", "copc.laz"}},
        FormatOption{"--base-bytes", {"glb"}},
        FormatOption{"--tile-bits", {"glb"}},
        FormatOption{"--tile-points", {"glb"}},
        FormatOption{"--tile-attributes", {"glb"}},
        FormatOption{"--exact-errors", {"glb"}},
        FormatOption{"--transform", {"glb"}},
        FormatOption{"--epsg", {"glb", "copc.laz"}}};
    const FormatOption* const lost =
        option_of_no_format(app, kOptions, {formats.begin(), formats.end()});
    if (lost == nullptr) return;
    std::string takers;
    for (const std::string_view format : lost->takers)
        takers += (takers.empty() ? "" : " or ") + std::string(format);
    throw UsageError(std::string(lost->name) +
                     ": no format of --formats takes it: omit it, or add " + takers);
}

PyramidCommand pyramid_command(const Values& values, const CLI::App& app) {
    PyramidCommand command{
        values.input, values.output, {}, values.layout == "potree", server_options(values.server),
        values.common};
    if (values.layout != "levels" && !command.potree)
        throw UsageError(
            "--layout " + values.layout + ": expected levels or potree" +
            (values.layout == "copc" ? "; COPC is one file: stipple convert IN OUT.copc.laz" : ""));
    command.job.outliers = outlier_options(values.outliers);
    if (command.potree) return potree_command(std::move(command), app);
    LodPyramidOptions& options = command.job.options;
    options = values.pyramid;
    options.sizes = values.levels;
    SimplifyOptions& method = options.simplification;
    method.method = method_from_name(values.method);
    if (values.refine != "replace" && values.refine != "add")
        throw UsageError("--refine " + values.refine + ": expected replace or add");
    options.nested = values.refine == "add";
    if (options.nested && app.count("--method") == 0) method.method = Method::Iterative;
    refuse_options_of_other_methods(app, method.method);
    set_method_options(values.of_methods, method);
    method.reductions = reductions_of(values.reductions);
    method.seed = values.seed;
    command.job.base_bytes = values.base_bytes;
    command.job.error = !values.no_error;
    std::set<CloudFormat> named;
    for (const std::string& name : values.formats) named.insert(cloud_format_from_name(name));
    require_options_of_levels(app, values.formats);
    std::ranges::copy_if(proto::kPyramidFormats, std::back_inserter(command.job.output.formats),
                         [&](CloudFormat format) { return named.contains(format); });
    command.job.output.draco = draco_options(values.encoding);
    command.job.tiles = values.tiles;
    command.job.tiles.precision = values.encoding.precision;
    if (!values.transform.empty()) {
        auto& transform = command.job.transform.emplace();
        std::ranges::copy(values.transform, transform.begin());
        const std::string_view expected = proto::transform_expected(transform);
        if (!expected.empty()) throw UsageError("--transform: expected " + std::string(expected));
    }
    if (values.epsg) {
        command.job.epsg = values.epsg;
        globe_frame(*values.epsg, Vec3d::Zero());  // refuses systems that it does not know
    }
    validate(options);
    validate(command.job.tiles);
    return command;
}

}  // namespace

CommandReader add_pyramid(CLI::App& app) {
    const auto shared = std::make_shared<Values>();
    Values& values = *shared;
    CLI::App& command = *app.add_subcommand("pyramid", "levels of detail, coarse to fine");
    add_input(command, values.input);
    command
        .add_option("OUTDIR", values.output,
                    "folder for the levels and manifest.json, or s3://BUCKET/PREFIX")
        ->required()
        ->type_name("FOLDER");
    auto* const levels =
        command.add_option("--levels", values.levels, "points of each level, as in 1000,10k,100k")
            ->delimiter(',')
            ->type_name("A,B,C")
            ->transform(point_count());
    command
        .add_option("--ratio", values.pyramid.ratio,
                    "points of a level over those of the one before, in (1, 64]; default 4")
        ->type_name("R")
        ->excludes(levels)
        ->transform(real_number("a factor in (1, 64], as in 4"));
    auto* const base_points = command
                                  .add_option("--base-points", values.pyramid.base_points,
                                              "most points of the coarsest level; default 10000")
                                  ->type_name("N")
                                  ->excludes(levels)
                                  ->transform(point_count());
    command
        .add_option("--base-bytes", values.base_bytes,
                    "instead: largest size of its glb, as in 14600 or 15kB")
        ->type_name("B")
        ->excludes(levels)
        ->excludes(base_points)
        ->transform(byte_count());
    command
        .add_option("--refine", values.refine,
                    "replace, or add: tiles add points to those above (iterative only)")
        ->type_name("R")
        ->capture_default_str();
    command
        .add_option("-m,--method", values.method,
                    "hierarchical; multiphase or iterative: less error, more time; or any other")
        ->type_name("M")
        ->capture_default_str();
    add_seed(command, values.seed);
    command
        .add_option("--formats", values.formats,
                    "any of drc, ply, glb (tiles), stpc (one stream), copc.laz (one octree); "
                    "default drc,ply,glb")
        ->delimiter(',')
        ->type_name("F,F");
    command
        .add_option("--layout", values.layout,
                    "levels, or potree: only a Potree 2 folder of the cloud")
        ->type_name("L")
        ->capture_default_str();
    command
        .add_option("--tile-bits", values.tiles.position_bits,
                    "bits per axis of the finest tiles, 2..24 for the longest side; default 14")
        ->type_name("B")
        ->transform(bit_count(2, 24));
    command
        .add_option("--tile-points", values.tiles.max_points,
                    "most points per tile, 1..65536; default 65536")
        ->type_name("N")
        ->transform(point_count())
        ->check(CLI::Range(1, 65536));
    command.add_flag("--tile-attributes", values.tiles.attributes,
                     "include scalar attributes in tiles: 32-bit integers and doubles as floats");
    command.add_flag_callback(
        "--exact-errors", [&values] { values.tiles.errors = LodErrors::Exact; },
        "measure tile errors at every point of the input: several times as long");
    command
        .add_option("--transform", values.transform,
                    "transform of the tileset, 16 numbers, column-major: to the globe (ECEF)")
        ->delimiter(',')
        ->expected(16)
        ->type_name("M");
    command
        .add_option("--epsg", values.epsg,
                    "instead: coordinate system, such as 32633 (UTM), to place it on the globe")
        ->excludes("--transform")
        ->type_name("CODE")
        ->transform(small_number("such as 32633 (UTM)"));
    add_reductions(command, values.reductions);
    add_remove_outliers(command, values.outliers);
    add_no_error(command, values.no_error);
    add_draco(command, values.encoding, ".drc, .laz, .stpc and the finest tiles");
    command.get_option("--tile-bits")->excludes("--precision");
    add_server(command, values.server);
    add_common(command, values.common);
    add_method_options(command, values.of_methods, kMethods);
    hide(command, {"--max-cluster-size", "--voxel-size"});
    command.get_option("--max-variation")
        ->group("For incremental")
        ->description("growth stops at this surface variation, in (0, 1/3]");
    command.footer(
        "Examples:\n"
        "  stipple pyramid scan.ply levels/\n"
        "  stipple pyramid scan.ply levels/ --levels 1000,10000,100000 --formats drc\n"
        "  stipple pyramid scan.ply s3://bucket/levels/ --method multiphase\n"
        "  stipple pyramid scan.ply levels/ --server http://127.0.0.1:8080");
    return {&command, [shared, &command] { return pyramid_command(*shared, command); }};
}

}  // namespace stipple::cli
