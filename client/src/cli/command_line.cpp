#include "cli/command_line.hpp"

#include "cli/command_options.hpp"
#include "cli/files.hpp"
#include "cli/names.hpp"
#include "cli/text.hpp"
#include "stipple/error.hpp"
#include "stipple/globe.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdlib>
#include <iterator>
#include <map>
#include <memory>
#include <numeric>
#include <set>
#include <sstream>
#include <utility>

namespace stipple::cli {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostOfLabel = 200;  // bytes, as `proto::EvaluationOptions` takes them

const Names<Reduction> kReductions = {{"mean", Reduction::Mean},
                                      {"nearest", Reduction::Nearest},
                                      {"min", Reduction::Min},
                                      {"max", Reduction::Max},
                                      {"mode", Reduction::Mode}};
const Names<SplatAttributes> kSplats = {{"none", SplatAttributes::None},
                                        {"radius", SplatAttributes::Radius},
                                        {"normal", SplatAttributes::Normal},
                                        {"ellipse", SplatAttributes::Ellipse}};
const Names<NormalSigns> kSigns = {{"mst", NormalSigns::SpanningTree}, {"none", NormalSigns::Any}};
const Names<DracoCoding> kCodings = {{"auto", DracoCoding::Auto},
                                     {"sequential", DracoCoding::Sequential},
                                     {"kd-tree", DracoCoding::KdTree}};
const Names<PlyEncoding> kPlyEncodings = {{"le", PlyEncoding::BinaryLittleEndian},
                                          {"be", PlyEncoding::BinaryBigEndian},
                                          {"ascii", PlyEncoding::Ascii}};

CloudFormat format_of(const fs::path& file, std::string_view endings = ".ply or .drc") {
    const std::string extension = extension_of(file);
    if (extension == ".ply") return CloudFormat::Ply;
    if (extension == ".drc") return CloudFormat::Draco;
    throw UsageError(file.string() + ": the name must end with " + std::string(endings));
}

ServerOptions server(const Values& values) {
    ServerOptions server = values.server;
    const char* const key = std::getenv("STIPPLE_API_KEY");
    if (values.has_server && server.url.empty())
        throw UsageError("--server: it is empty: expected http://HOST:PORT");
    if (server.url.empty() && !server.api_key.empty())
        throw UsageError("--api-key without --server: name the server that the key is for");
    if (server.api_key.empty() && key != nullptr) server.api_key = key;
    return server;
}

DracoEncodeOptions draco(const Values& values) {
    DracoEncodeOptions draco = values.draco;
    draco.coding = named(kCodings, values.coding, "--coding");
    draco.precision = values.precision;
    return draco;
}

PlyEncodeOptions ply(const Values& values) {
    return {named(kPlyEncodings, values.ply_encoding, "--ply-encoding"), {}};
}

std::map<std::string, Reduction> reductions(const Values& values) {
    std::map<std::string, Reduction> reductions;
    for (const std::string& text : values.reductions) {
        const std::size_t equals = text.rfind('=');  // a name may have others
        if (equals == 0 || equals == text.npos)
            throw UsageError("--reduce " + text + ": expected NAME=POLICY, as in intensity=max");
        reductions[text.substr(0, equals)] =
            named(kReductions, text.substr(equals + 1), "--reduce");
    }
    return reductions;
}

/// A number of input units, or a percentage of the diagonal.
template <typename Options>
void set_max_error(const std::string& text, Options& options) {
    if (text.empty()) return;
    double value = 0;
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    if (error == std::errc() && stop == end)
        options.max_error = value;
    else
        options.max_error_rel = proto::part_of_diagonal(text);
}

proto::AddedAttributes added_attributes(const Values& values) {
    return {named(kSplats, values.splats, "--splats"), values.source_index};
}

/// All of a command but the options of its job.
template <typename Job>
FileCommand<Job> file_command(const Values& values) {
    FileCommand<Job> command{values.input, values.output,  {},
                             ply(values),  server(values), values.common};
    command.job.output = {{format_of(values.output)}, draco(values)};
    if constexpr (requires { command.job.added; }) command.job.added = added_attributes(values);
    if constexpr (requires { command.job.error; }) command.job.error = !values.no_error;
    return command;
}

/// What says how many points a method leaves.
std::string targets_of(Method method) {
    if (method == Method::Voxel) return "--points N, --ratio R or --voxel-size S";
    if (method == Method::Incremental) return "--points N, --ratio R or --max-cluster-size N";
    const bool bounded =
        std::ranges::find(kErrorBoundedMethods, method) != kErrorBoundedMethods.end();
    return bounded ? "--points N, --ratio R or --max-error E" : "--points N or --ratio R";
}

SimplifyCommand simplify_command(const Values& values, const CLI::App& app) {
    auto command = file_command<proto::SimplifyJob>(values);
    SimplifyOptions& options = command.job.options;
    options.method = method_from_name(values.method);
    refuse_options_of_other_methods(app, options.method);
    options.points = values.points;
    options.ratio = values.ratio;
    set_max_error(values.max_error, options);
    set_method_options(values.of_methods, options);
    options.reductions = reductions(values);
    options.seed = values.seed;
    const MethodValues& own = values.of_methods;
    if (!values.points && !values.ratio && values.max_error.empty() && !own.max_cluster_size &&
        !own.max_variation && !own.voxel_size)
        throw UsageError("how many points? give " + targets_of(options.method));
    if (int{values.points.has_value()} + int{values.ratio.has_value()} +
            int{!values.max_error.empty()} >
        1)
        throw UsageError("--points, --ratio and --max-error: give one of them");
    validate(options);
    return command;
}

UpsampleCommand upsample_command(const Values& values) {
    auto command = file_command<proto::UpsampleJob>(values);
    UpsampleOptions& options = command.job.options;
    options.points = values.points;
    options.ratio = values.ratio;
    if (!values.points && !values.ratio)
        throw UsageError("how many points? give --points N or --ratio R");
    options.particles = particle_options(values.of_methods);
    options.particles.seed = values.seed;
    options.particles.reductions = reductions(values);
    validate(options);
    return command;
}

AnalyzeCommand analyze_command(const Values& values) {
    AnalyzeCommand command{file_command<proto::AnalyzeJob>(values), values.feature_lines};
    SurfaceAttributeOptions& options = command.job.options;
    options = values.surface;
    options.signs = named(kSigns, values.orient, "--orient");
    if (!values.viewpoint.empty()) {
        options.signs = NormalSigns::Viewpoint;
        options.viewpoint = read_position(values.viewpoint, "--viewpoint");
    }
    if (!values.feature_lines.empty()) {
        format_of(values.feature_lines);
        options.feature_lines = values.features;
    }
    validate(options);
    return command;
}

/// Potree's octree is made of the cloud itself: a pyramid of one level.
PyramidCommand potree_command(PyramidCommand command, const CLI::App& app) {
    for (const CLI::Option* const option : app.get_options()) {
        const std::string name = option->get_name();
        const bool taken = name == "--layout" || name == "--server" || name == "--api-key" ||
                           name == "--threads" || name == "--json" || name == "--quiet";
        if (name.starts_with("--") && option->count() > 0 && !taken)
            throw UsageError(name + " does not go with --layout potree");
    }
    command.job.options.sizes = {UINT32_MAX};
    command.job.output.formats = {CloudFormat::Ply};
    command.job.error = false;
    return command;
}

PyramidCommand pyramid_command(const Values& values, const CLI::App& app) {
    PyramidCommand command{values.input,   values.output, {}, values.layout == "potree",
                           server(values), values.common};
    if (values.layout != "levels" && !command.potree)
        throw UsageError(
            "--layout " + values.layout + ": expected levels or potree" +
            (values.layout == "copc" ? "; COPC is one file: stipple convert IN OUT.copc.laz" : ""));
    if (command.potree) return potree_command(std::move(command), app);
    LodPyramidOptions& options = command.job.options;
    options = values.pyramid;
    options.sizes = values.levels;
    SimplifyOptions& method = options.simplification;
    method.method = method_from_name(values.pyramid_method);
    if (values.refine != "replace" && values.refine != "add")
        throw UsageError("--refine " + values.refine + ": expected replace or add");
    options.nested = values.refine == "add";
    if (options.nested && app.count("--method") == 0) method.method = Method::Iterative;
    refuse_options_of_other_methods(app, method.method);
    set_method_options(values.of_methods, method);
    method.reductions = reductions(values);
    method.seed = values.seed;
    command.job.base_bytes = values.base_bytes;
    command.job.error = !values.no_error;
    std::vector<CloudFormat>& formats = command.job.output.formats;
    for (const std::string& name : values.formats) {
        const CloudFormat format = cloud_format_from_name(name);
        if (std::find(formats.begin(), formats.end(), format) == formats.end())
            formats.push_back(format);
    }
    command.job.output.draco = draco(values);
    command.job.tiles = values.tiles;
    command.job.tiles.precision = values.precision;
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

SliceCommand slice_command(const Values& values) {
    SliceCommand command{values.input, values.output, {}, server(values), values.common};
    proto::SliceOptions& options = command.options;
    options.points = values.points;
    options.bytes = values.bytes;
    set_max_error(values.max_error, options);
    if (!values.box.empty()) {
        const std::vector<double>& b = values.box;
        options.box = Aabb{Vec3d(b[0], b[1], b[2]), Vec3d(b[3], b[4], b[5])};
    }
    const std::string extension = extension_of(command.output);
    options.format =
        extension == ".glb" ? CloudFormat::Glb : format_of(values.output, ".ply, .drc or .glb");
    options.draco = draco(values);
    validate(options);
    return command;
}

EvaluateCommand evaluate_command(const Values& values) {
    EvaluateCommand command{
        values.input,   {},           {}, {values.maps.begin(), values.maps.end()},
        server(values), values.common};
    proto::EvaluationOptions& options = command.job.options;
    options = values.evaluation;
    options.measure.sampling = proto::error_sampling_from_name(values.sampling);
    if (!values.basis.empty())
        options.measure.surface = proto::error_surface_from_name(values.basis);
    if (values.candidates.size() > proto::kMostCandidates)
        throw UsageError(std::to_string(values.candidates.size()) + " candidates: at most " +
                         std::to_string(proto::kMostCandidates));
    for (const std::string& candidate : values.candidates) {
        command.candidates.emplace_back(candidate);
        options.labels.push_back(
            shortened(printable(command.candidates.back().filename().string()), kMostOfLabel));
    }
    if (values.up.size() != 1) throw UsageError("--up " + values.up + ": expected x, y or z");
    options.up = values.up.front();
    for (const fs::path& map : command.maps) {
        if (extension_of(map) == ".png") {
            options.pictures = true;
            continue;
        }
        std::vector<CloudFormat>& formats = command.job.output.formats;
        const CloudFormat format = format_of(map, ".ply, .drc or .png");
        if (std::find(formats.begin(), formats.end(), format) == formats.end())
            formats.push_back(format);
    }
    command.job.output.draco = draco(values);
    validate(options);
    return command;
}

CurveCommand curve_command(const Values& values, const CLI::App& app) {
    CurveCommand command{values.input, values.plot, {}, server(values), values.common};
    if (!values.plot.empty() && extension_of(command.plot) != ".svg")
        throw UsageError(values.plot + ": the name must end with .svg");
    ErrorCurveOptions& options = command.job.options;
    options.simplification.method = method_from_name(values.method);
    refuse_options_of_other_methods(app, options.simplification.method);
    set_method_options(values.of_methods, options.simplification);
    options.simplification.seed = values.seed;
    options.points = values.curve_points;
    std::ranges::sort(options.points);
    options.count = values.curve_count;
    validate(options);
    return command;
}

ConvertCommand convert_command(const Values& values) {
    const std::string extension = extension_of(values.output);
    if (extension != ".stpc" && extension != ".laz") format_of(values.output, kConvertEndings);
    if (values.epsg) well_known_text(*values.epsg);  // refuses systems that it does not know
    return {values.input,
            values.output,
            values.first_points,
            values.first_bytes,
            draco(values),
            ply(values),
            {.precision = values.precision, .epsg = values.epsg},
            values.common};
}

SynthesizeCommand synthesize_command(const Values& values) {
    format_of(values.output);
    return {values.output, values.synthetic, draco(values), ply(values), values.common};
}

/// CLI11 would list all that follows an unknown command, last things first.
void require_command(const CLI::App& app, const std::vector<std::string>& arguments) {
    if (arguments.empty() || arguments.front().starts_with('-')) return;
    std::string names;
    for (const CLI::App* const command : app.get_subcommands({})) {
        if (command->check_name(arguments.front())) return;
        names += (names.empty() ? "" : ", ") + command->get_name();
    }
    throw UsageError(arguments.front() + ": no such command: expected one of " + names);
}

/// Characters to put in, take out or change until one word is the other.
std::size_t edit_distance(std::string_view a, std::string_view b) {
    std::vector<std::size_t> row(b.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < a.size(); ++i) {
        std::size_t diagonal = std::exchange(row[0], i + 1);
        for (std::size_t j = 0; j < b.size(); ++j) {
            const std::size_t changed = diagonal + (a[i] == b[j] ? 0 : 1);
            diagonal = row[j + 1];
            row[j + 1] = std::min({row[j] + 1, diagonal + 1, changed});
        }
    }
    return row.back();
}

/// The long option, of those in the help, that was probably meant; empty when none is near.
std::string option_near(const CLI::App& command, const std::string& name) {
    std::vector<const CLI::Option*> options = command.get_options();
    for (const CLI::App* const group : command.get_subcommands({}))
        std::ranges::copy(group->get_options(), std::back_inserter(options));
    const std::size_t letters = name.size() - 2;
    std::size_t distance = 1 + std::min<std::size_t>(2, letters / 3);
    std::string nearest;
    for (const CLI::Option* const option : options) {
        for (const std::string& known : option->get_lnames()) {
            const std::size_t edits = edit_distance(name, "--" + known);
            if (option->get_group().empty() || edits >= distance) continue;
            nearest = "--" + known;
            distance = edits;
        }
    }
    return nearest;
}

/// CLI11 would list all that it could not place, last things first, or name only what is missing.
void require_known_options(const CLI::App& app, const std::vector<std::string>& arguments) {
    const auto commands = app.get_subcommands(
        [&](const CLI::App* command) { return command->check_name(arguments.front()); });
    const CLI::App& command = commands.empty() ? app : *commands.front();
    for (const std::string& argument : arguments) {
        if (argument == "--") return;
        const std::string name = argument.substr(0, argument.find('='));
        if (!name.starts_with("--") || command.get_option_no_throw(name) != nullptr) continue;
        const std::string near = option_near(command, name);
        throw UsageError(name + ": no such option" +
                         (near.empty() ? " (see --help)" : ": did you mean " + near + "?"));
    }
}

/// CLI11 takes arguments from the back.
std::vector<std::string> reversed(std::vector<std::string> arguments) {
    std::reverse(arguments.begin(), arguments.end());
    return arguments;
}

/// An option of another format than those of the outputs would change nothing.
void require_options_of_formats(const CLI::App& command, const std::vector<std::string>& outputs) {
    struct FormatOption {
        const char* name;
        std::vector<std::string_view> extensions;
    };
    static const std::array kOptions = {FormatOption{"--position-bits", {".drc"}},
                                        FormatOption{"--normal-bits", {".drc"}},
                                        FormatOption{"--attribute-bits", {".drc"}},
                                        FormatOption{"--coding", {".drc"}},
                                        FormatOption{"--precision", {".drc", ".laz", ".stpc"}},
                                        FormatOption{"--ply-encoding", {".ply"}},
                                        FormatOption{"--epsg", {".laz"}},
                                        FormatOption{"--views", {".png"}},
                                        FormatOption{"--up", {".png"}}};
    std::set<std::string, std::less<>> given;
    for (const fs::path output : outputs) given.insert(extension_of(output));
    for (const auto& [name, extensions] : kOptions) {
        const CLI::Option* const option = command.get_option_no_throw(name);
        if (option == nullptr || option->count() == 0) continue;
        if (std::ranges::any_of(extensions, [&](auto own) { return given.contains(own); }))
            continue;
        const std::string own(extensions.front());
        throw UsageError(
            std::string(name) + ": belongs to " + own +
            (command.get_name() == "evaluate"
                 ? ": leave it out, or ask for a --map that ends with " + own
                 : ", not to " + *given.begin() + ": leave it out, or give OUT another ending"));
    }
}

Command parse(CLI::App& app, Values& values, const std::vector<std::string>& arguments) {
    const CLI::App& simplify = add_simplify(app, values);
    const CLI::App& upsample = add_upsample(app, values);
    const CLI::App& analyze = add_analyze(app, values);
    const CLI::App& pyramid = add_pyramid(app, values);
    const CLI::App& slice = add_slice(app, values);
    const CLI::App& evaluate = add_evaluate(app, values);
    const CLI::App& curve = add_curve(app, values);
    const CLI::App& inspect = add_inspect(app, values);
    const CLI::App& convert = add_convert(app, values);
    const CLI::App& synthesize = add_synthesize(app, values);
    require_command(app, arguments);
    app.parse(reversed(arguments));
    for (const CLI::App* const command :
         {&simplify, &upsample, &analyze, &slice, &convert, &synthesize})
        if (command->parsed()) require_options_of_formats(*command, {values.output});
    if (evaluate.parsed()) require_options_of_formats(evaluate, values.maps);

    if (simplify.parsed()) return simplify_command(values, simplify);
    if (upsample.parsed()) return upsample_command(values);
    if (analyze.parsed()) return analyze_command(values);
    if (pyramid.parsed()) return pyramid_command(values, pyramid);
    if (slice.parsed()) return slice_command(values);
    if (curve.parsed()) return curve_command(values, curve);
    if (inspect.parsed()) return InspectCommand{values.input, values.common};
    if (evaluate.parsed()) return evaluate_command(values);
    if (convert.parsed()) return convert_command(values);
    if (synthesize.parsed()) return synthesize_command(values);
    return InfoCommand{app.help()};
}

/// Help for a terminal of 80 columns.
class HelpFormatter : public CLI::Formatter {
public:
    HelpFormatter() { column_width(kColumn); }
    std::string make_option_desc(const CLI::Option* option) const override {
        std::istringstream words(CLI::Formatter::make_option_desc(option));
        std::string text, word;
        std::size_t at = 0;
        while (words >> word) {
            const bool fits = at + 1 + word.size() <= kWidth;
            if (at > 0) text += fits ? ' ' : '\n';
            at = at > 0 && fits ? at + 1 + word.size() : word.size();
            text += word;
        }
        return text;
    }
    /// Options of which one is needed, under a heading as other groups have it.
    std::string make_expanded(const CLI::App* group) const override {
        const auto own = group->get_options(
            [group](const CLI::Option* option) { return option != group->get_help_ptr(); });
        return '\n' + make_group(group->get_group(), false, own);
    }

private:
    static constexpr std::size_t kColumn = 32, kWidth = 78 - kColumn;  // groups are indented
};

/// `help [COMMAND]` is `[COMMAND] --help`.
std::vector<std::string> with_help_as_option(std::vector<std::string> arguments) {
    if (arguments.empty() || arguments.front() != "help") return arguments;
    arguments.erase(arguments.begin());
    arguments.emplace_back("--help");
    return arguments;
}

std::string one_line(std::string text) {
    std::replace(text.begin(), text.end(), '\n', ' ');
    return text;
}

}  // namespace

Command parse_command_line(const std::vector<std::string>& words) {
    const std::vector<std::string> arguments = with_help_as_option(words);
    CLI::App app("stipple: smaller point clouds that still describe the same surface.", "stipple");
    app.set_version_flag("--version", "stipple " STIPPLE_VERSION);
    app.formatter(std::make_shared<HelpFormatter>());
    app.require_subcommand(0, 1);
    app.footer(
        "Examples:\n"
        "  stipple synthesize ammonite.ply --points 500000\n"
        "  stipple inspect ammonite.ply\n"
        "  stipple simplify ammonite.ply small.drc --points 5000\n"
        "  stipple pyramid ammonite.ply levels/\n"
        "\nstipple COMMAND --help tells more about each.");
    Values values;
    try {
        return parse(app, values, arguments);
    } catch (const CLI::CallForHelp&) {
        return InfoCommand{app.help()};  // of the command that was asked, when there is one
    } catch (const CLI::CallForVersion& version) {
        return InfoCommand{std::string(version.what()) + "\n"};
    } catch (const CLI::ParseError& error) {
        require_known_options(app, arguments);
        throw UsageError(one_line(error.what()) + " (see --help)");
    } catch (const Error& error) {  // an option that the library refuses
        throw UsageError(error.what());
    }
}

}  // namespace stipple::cli
