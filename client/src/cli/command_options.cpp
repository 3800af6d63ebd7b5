#include "cli/command_options.hpp"

#include "cli/numbers.hpp"

namespace stipple::cli {
namespace {

// Options in groups that several commands share.

void add_common(CLI::App& command, Values& values) {
    command
        .add_option("--threads", values.common.threads, "threads of a local run; 0: one per core")
        ->type_name("T")
        ->check(CLI::Range(0, 1024));
    command
        .add_option("--json", values.common.json,
                    "write the figures as JSON; - for standard output")
        ->type_name("FILE");
    command.add_flag("-q,--quiet", values.common.quiet, "no progress and no summary");
}

void add_server(CLI::App& command, Values& values) {
    command.add_option("--server", values.server.url, "let this stippled do it: http://HOST:PORT")
        ->type_name("URL")
        ->each([&values](const std::string&) { values.has_server = true; });
    command.add_option("--api-key", values.server.api_key, "its key; better in STIPPLE_API_KEY")
        ->type_name("KEY");
}

void add_reductions(CLI::App& command, Values& values) {
    command
        .add_option("--reduce", values.reductions,
                    "mean, nearest, min, max or mode, for one attribute")
        ->type_name("NAME=POLICY")
        ->allow_extra_args(false);
}

void add_no_error(CLI::App& command, Values& values) {
    command.add_flag("--no-error", values.no_error, "do not measure how far the result is off");
}

void add_added_attributes(CLI::App& command, Values& values) {
    add_no_error(command, values);
    command
        .add_option("--splats", values.splats,
                    "what to write of each point's splat: none, radius, normal or ellipse")
        ->type_name("S")
        ->capture_default_str();
    command.add_flag("--source-index", values.source_index,
                     "write which point of IN each was, as source_index");
}

/// @param precise  what of its files `--precision` is about.
void add_draco(CLI::App& command, Values& values, const std::string& precise = ".drc") {
    auto* const bits = command
                           .add_option("--position-bits", values.draco.position_bits,
                                       "of .drc: 1..30, or 0: exact floats; 14")
                           ->type_name("B")
                           ->transform(bit_count(1, "exact floats"));
    command
        .add_option("--precision", values.precision,
                    "of " + precise + ": largest error per axis, input units")
        ->type_name("E")
        ->excludes(bits)
        ->transform(precision());
    command.add_option("--normal-bits", values.draco.normal_bits, "of .drc: 2..30; 10")
        ->type_name("B")
        ->transform(bit_count(2, nullptr));
    command
        .add_option("--attribute-bits", values.draco.attribute_bits,
                    "of .drc: 1..30 for floats, or 0: exact floats; 16")
        ->type_name("B")
        ->transform(bit_count(1, "exact floats"));
    command
        .add_option("--coding", values.coding,
                    "of .drc: auto (default), sequential, which keeps the order, or kd-tree")
        ->type_name("C");
}

void add_ply(CLI::App& command, Values& values) {
    command.add_option("--ply-encoding", values.ply_encoding, "of .ply: le (default), be or ascii")
        ->type_name("E");
}

void add_input(CLI::App& command, Values& values) {
    command.add_option("IN", values.input, "a PLY, Draco or progressive file, whatever its name")
        ->required()
        ->type_name("FILE");
}

void add_output(CLI::App& command, Values& values) {
    command.add_option("OUT", values.output, "a .ply or .drc file")->required()->type_name("FILE");
}

/// How the cloud is written, and where the work is done.
void add_encoding(CLI::App& command, Values& values) {
    add_draco(command, values);
    add_ply(command, values);
    add_server(command, values);
    add_common(command, values);
}

void add_seed(CLI::App& command, Values& values) {
    command.add_option("--seed", values.seed, "of methods that draw at random")
        ->type_name("S")
        ->capture_default_str()
        ->transform(whole_number());
}

/// Leaves bounds out of the help: they are refused, for the command has counts of its own.
void hide(CLI::App& command, std::initializer_list<const char*> bounds) {
    for (const char* const bound : bounds) command.get_option(bound)->group("");
}

std::string methods() {
    std::string names;
    for (const Method method : kMethods)
        names += (names.empty() ? "" : ", ") + std::string(to_string(method));
    return names;
}

}  // namespace

CLI::App& add_simplify(CLI::App& app, Values& values) {
    CLI::App& command = *app.add_subcommand("simplify", "fewer points, the same surface");
    add_input(command, values);
    add_output(command, values);
    command.add_option("-m,--method", values.method, methods())
        ->type_name("M")
        ->capture_default_str();
    command.add_option("-n,--points", values.points, "exactly so many points: 5000, 10k, 1.5M")
        ->type_name("N")
        ->transform(point_count());
    command
        .add_option("-r,--ratio", values.ratio, "this share of the points, in (0, 1], or as 10%")
        ->type_name("R")
        ->transform(share());
    command
        .add_option("--max-error", values.max_error,
                    "as few points as are found within this distance: input units, or as in 0.1% "
                    "of the diagonal")
        ->type_name("E");
    add_seed(command, values);
    add_reductions(command, values);
    add_added_attributes(command, values);
    add_encoding(command, values);
    add_method_options(command, values.of_methods, kMethods);
    command.footer(
        "Examples:\n"
        "  stipple simplify scan.ply small.ply --points 5000\n"
        "  stipple simplify scan.ply small.drc --ratio 0.01 --precision 0.001\n"
        "  stipple simplify scan.ply small.ply --max-error 0.1%\n"
        "  stipple simplify scan.ply small.ply -m iterative -n 5000 --color-weight 0.1\n"
        "  stipple simplify scan.ply small.ply -m hierarchical --max-variation 0.02\n"
        "  stipple simplify scan.ply even.ply -m particles -n 5000 \\\n"
        "      --region sphere:0,0,0,1:4\n"
        "  stipple simplify scan.ply small.drc -n 5000 --server http://127.0.0.1:8080");
    return command;
}

CLI::App& add_upsample(CLI::App& app, Values& values) {
    CLI::App& command = *app.add_subcommand("upsample", "more points on the same surface");
    add_input(command, values);
    add_output(command, values);
    command.add_option("-n,--points", values.points, "exactly so many points, more than IN has")
        ->type_name("N")
        ->transform(point_count());
    command.add_option("-r,--ratio", values.ratio, "so many times the points, above 1")
        ->type_name("R")
        ->transform(real_number("so many times the points, above 1, as in 2"));
    add_particle_options(command, values.of_methods);
    command.add_option("--seed", values.seed, "another seed, other points")
        ->type_name("S")
        ->capture_default_str()
        ->transform(whole_number());
    add_reductions(command, values);
    add_added_attributes(command, values);
    add_encoding(command, values);
    command.footer(
        "Examples:\n"
        "  stipple upsample scan.ply dense.ply --ratio 4\n"
        "  stipple upsample scan.ply dense.drc --points 1000000");
    return command;
}

CLI::App& add_analyze(CLI::App& app, Values& values) {
    CLI::App& command =
        *app.add_subcommand("analyze", "normals, variation, density and anisotropy");
    add_input(command, values);
    add_output(command, values);
    command.add_option("--k", values.surface.k, "neighbours, 3..64; 0: chosen for each point")
        ->type_name("K")
        ->capture_default_str()
        ->transform(small_number("3..64, or 0: chosen for each point"));
    auto* const orient =
        command.add_option("--orient", values.orient, "signs of the normals: mst or none")
            ->type_name("O")
            ->capture_default_str();
    command
        .add_option("--viewpoint", values.viewpoint, "turn the normals towards this point instead")
        ->type_name("X,Y,Z")
        ->excludes(orient);
    auto* const lines =
        command
            .add_option("--feature-lines", values.feature_lines,
                        "write the points of creases there, and their weight in OUT")
            ->type_name("FILE");
    command
        .add_option("--feature-variation", values.features.variation,
                    "surface variation of a crease, in (0, 1/3)")
        ->type_name("S")
        ->capture_default_str()
        ->transform(real_number("a number in (0, 1/3), as in 0.05"))
        ->needs(lines);
    add_encoding(command, values);
    command.footer(
        "Examples:\n"
        "  stipple analyze scan.ply analyzed.ply\n"
        "  stipple analyze scan.ply analyzed.ply --k 24 --viewpoint 0,0,10\n"
        "  stipple analyze scan.ply analyzed.ply --feature-lines creases.ply");
    return command;
}

CLI::App& add_pyramid(CLI::App& app, Values& values) {
    CLI::App& command = *app.add_subcommand("pyramid", "levels of detail, coarse to fine");
    add_input(command, values);
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
    command.add_option("--ratio", values.pyramid.ratio, "from a level to the next, in (1, 64]; 4")
        ->type_name("R")
        ->excludes(levels)
        ->transform(
            real_number("how many times the points of a level the next has, in (1, 64], as in 4"));
    auto* const base_points = command
                                  .add_option("--base-points", values.pyramid.base_points,
                                              "most points of the coarsest; 10000")
                                  ->type_name("N")
                                  ->excludes(levels)
                                  ->transform(point_count());
    command
        .add_option("--base-bytes", values.base_bytes,
                    "instead: most bytes of its glb, as in 14600 or 15kB")
        ->type_name("B")
        ->excludes(levels)
        ->excludes(base_points)
        ->transform(byte_count());
    command
        .add_option("--refine", values.refine,
                    "replace; or add: a level's tiles add points to those above, iterative alone")
        ->type_name("R")
        ->capture_default_str();
    command
        .add_option("-m,--method", values.pyramid_method,
                    "hierarchical; multiphase, iterative: less error, more time; or any other")
        ->type_name("M")
        ->capture_default_str();
    add_seed(command, values);
    command
        .add_option(
            "--formats", values.formats,
            "of drc, ply, glb (tiles), stpc (one stream), copc.laz (one octree); drc,ply,glb")
        ->delimiter(',')
        ->type_name("F,F");
    command
        .add_option("--layout", values.layout,
                    "levels; or potree: the cloud as a folder of Potree 2, and nothing else")
        ->type_name("L")
        ->capture_default_str();
    command
        .add_option("--tile-bits", values.tiles.position_bits,
                    "of the finest tiles' grid, 2..24 for the longest side; 14")
        ->type_name("B")
        ->transform(small_number("2..24"));
    command.add_option("--tile-points", values.tiles.max_points, "most points of a tile; 65536")
        ->type_name("N")
        ->transform(point_count());
    command.add_flag("--tile-attributes", values.tiles.attributes,
                     "scalar attributes in the tiles, too: 32-bit integers and doubles as floats");
    command.add_flag_callback(
        "--exact-errors", [&values] { values.tiles.errors = LodErrors::Exact; },
        "of tiles, measured at every point of the input: several times as long");
    command
        .add_option("--transform", values.transform,
                    "of the tileset, 16 numbers column by column: to the globe (ECEF)")
        ->delimiter(',')
        ->expected(16)
        ->type_name("M");
    command
        .add_option("--epsg", values.epsg,
                    "instead: the coordinates are of this system, as 32633 (UTM), to be put on "
                    "the globe")
        ->excludes("--transform")
        ->type_name("CODE")
        ->transform(small_number("as 32633 (UTM)"));
    add_reductions(command, values);
    add_no_error(command, values);
    add_draco(command, values, ".drc, .laz, .stpc and the finest tiles");
    add_server(command, values);
    add_common(command, values);
    add_method_options(command, values.of_methods, kMethods);
    hide(command, {"--max-cluster-size", "--voxel-size"});
    command.get_option("--max-variation")
        ->group("Of incremental")
        ->description("of incremental: growth stops at this surface variation, in (0, 1/3]");
    command.footer(
        "Examples:\n"
        "  stipple pyramid scan.ply levels/\n"
        "  stipple pyramid scan.ply levels/ --levels 1000,10000,100000 --formats drc\n"
        "  stipple pyramid scan.ply s3://bucket/levels/ --method multiphase\n"
        "  stipple pyramid scan.ply levels/ --server http://127.0.0.1:8080");
    return command;
}

CLI::App& add_slice(CLI::App& app, Values& values) {
    CLI::App& command =
        *app.add_subcommand("slice", "a cloud cut from a pyramid, by budget and place");
    command
        .add_option("PYRAMID", values.input,
                    "folder that `stipple pyramid` wrote; with --server the id of its job")
        ->required();
    command.add_option("OUT", values.output, "a .ply, .drc or .glb file")
        ->required()
        ->type_name("FILE");
    auto* const budget = command.add_option_group("What is wanted, one of these");
    budget->add_option("-n,--points", values.points, "exactly so many points, or all there are")
        ->type_name("N")
        ->transform(point_count());
    budget
        ->add_option("--bytes", values.bytes,
                     "as many points as OUT has room for in B bytes, as in 500kB")
        ->type_name("B")
        ->transform(byte_count());
    budget
        ->add_option("--max-error", values.max_error,
                     "the coarsest level within this: input units, or as in 0.1% of the diagonal")
        ->type_name("E");
    budget->require_option(1);
    command
        .add_option("--box", values.box,
                    "only what lies in it: x0,y0,z0,x1,y1,z1; scalars with --tile-attributes alone")
        ->delimiter(',')
        ->expected(6)
        ->type_name("BOX");
    add_draco(command, values);
    add_server(command, values);
    add_common(command, values);
    command.footer(
        "Examples:\n"
        "  stipple slice levels/ preview.ply --points 20000\n"
        "  stipple slice levels/ door.glb --bytes 500000 --box 0,0,0,2,1,2.5\n"
        "  stipple slice 0123456789abcdef0123456789abcdef small.drc --max-error 0.05 \\\n"
        "      --server http://127.0.0.1:8080");
    return command;
}

CLI::App& add_evaluate(CLI::App& app, Values& values) {
    proto::EvaluationOptions& options = values.evaluation;
    CLI::App& command =
        *app.add_subcommand("evaluate", "how far a cloud's surface is from another's");
    command
        .add_option("REFERENCE", values.input, "the cloud that is right: PLY, Draco or progressive")
        ->required()
        ->type_name("FILE");
    command.add_option("CANDIDATE", values.candidates, "clouds to compare with it")
        ->required()
        ->type_name("FILE");
    command
        .add_option(
            "--map", values.maps,
            "write the reference coloured by distance (.ply, .drc) or pictures of it (.png)")
        ->type_name("OUT")
        ->allow_extra_args(false);
    command
        .add_option(
            "--samples", options.measure.samples,
            "distances on each surface; 0: 40000, or one a point, and the maximum of all points")
        ->type_name("N")
        ->capture_default_str()
        ->transform(point_count());
    command
        .add_option("--sampling", values.sampling,
                    "where: points, surface (random places) or particles (as the paper has it)")
        ->type_name("S")
        ->capture_default_str();
    command
        .add_option("--basis", values.basis,
                    "of the surface: linear (default), quadratic, or samples: the points alone")
        ->type_name("B");
    command.add_option("--k", options.measure.k, "neighbours that make a surface, 6..64")
        ->type_name("K")
        ->capture_default_str()
        ->transform(small_number("6..64"));
    command.add_option("--seed", options.measure.seed, "another seed, other samples")
        ->type_name("S")
        ->capture_default_str()
        ->transform(whole_number());
    command.add_flag("--attributes", options.measure.attributes,
                     "colours, normals and scalars as well");
    command.add_option("--range", options.range, "distance of the last colour; found by itself")
        ->type_name("MAX")
        ->transform(real_number("a distance above 0, in input units, as in 0.5"));
    command
        .add_option("--views", options.views,
                    "of .png: some of front,right,back,left (default), top, bottom")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->type_name("V,V");
    command.add_option("--up", values.up, "axis that is up in pictures: x, y or z")
        ->type_name("A")
        ->capture_default_str();
    add_draco(command, values);
    add_server(command, values);
    add_common(command, values);
    command.footer(
        "Examples:\n"
        "  stipple evaluate scan.ply small.ply\n"
        "  stipple evaluate scan.ply a.ply b.drc --json errors.json --map errors.png\n"
        "  stipple evaluate scan.ply small.ply --map errors.ply --range 0.5");
    return command;
}

CLI::App& add_curve(CLI::App& app, Values& values) {
    CLI::App& command = *app.add_subcommand("curve", "how the error grows as points go");
    add_input(command, values);
    command
        .add_option("-m,--method", values.method,
                    "multiphase, hierarchical, iterative or particles")
        ->type_name("M")
        ->capture_default_str();
    auto* const points =
        command
            .add_option("-n,--points", values.curve_points, "at these counts, as in 1000,5000,20k")
            ->delimiter(',')
            ->type_name("A,B,C")
            ->transform(point_count());
    command
        .add_option("--count", values.curve_count,
                    "at so many, from half of the points (a million at most) to a "
                    "thousandth, 2..64")
        ->type_name("K")
        ->capture_default_str()
        ->excludes(points)
        ->transform(small_number("2..64"));
    command.add_option("--plot", values.plot, "draw it, as a .svg file")->type_name("FILE");
    add_seed(command, values);
    add_server(command, values);
    add_common(command, values);
    add_method_options(command, values.of_methods, kErrorBoundedMethods);
    hide(command, {"--max-cluster-size", "--max-variation"});
    command.footer(
        "Examples:\n"
        "  stipple curve scan.ply --plot curve.svg\n"
        "  stipple curve scan.ply -m iterative --points 1000,5000,20k --json curve.json");
    return command;
}

CLI::App& add_inspect(CLI::App& app, Values& values) {
    CLI::App& command = *app.add_subcommand("inspect", "what is in a file");
    add_input(command, values);
    add_common(command, values);
    command.footer(
        "Examples:\n"
        "  stipple inspect scan.ply\n"
        "  stipple inspect scan.drc --json -");
    return command;
}

CLI::App& add_convert(CLI::App& app, Values& values) {
    CLI::App& command = *app.add_subcommand("convert", "the points as PLY, Draco, stream or COPC");
    add_input(command, values);
    command.add_option("OUT", values.output, "a " + std::string(kConvertEndings) + " (COPC) file")
        ->required()
        ->type_name("FILE");
    command.add_option("--points", values.first_points, "of a .stpc: the first so many")
        ->type_name("N")
        ->transform(point_count());
    command.add_option("--bytes", values.first_bytes, "of a .stpc: what so many hold")
        ->type_name("B")
        ->transform(byte_count());
    add_draco(command, values, ".drc, .laz and .stpc");
    add_ply(command, values);
    command
        .add_option("--epsg", values.epsg,
                    "of .laz: the coordinates are of this system, as 32633 (UTM)")
        ->type_name("CODE")
        ->transform(small_number("as 32633 (UTM)"));
    add_common(command, values);
    command.footer(
        "Examples:\n"
        "  stipple convert scan.ply scan.drc --position-bits 16\n"
        "  stipple convert scan.drc scan.ply --ply-encoding ascii\n"
        "  stipple convert scan.ply scan.copc.laz\n"
        "  stipple convert scan.ply scan.stpc\n"
        "  stipple convert scan.stpc first.ply --points 10000");
    return command;
}

CLI::App& add_synthesize(CLI::App& app, Values& values) {
    CLI::App& command = *app.add_subcommand("synthesize", "a cloud to try things on: an ammonite");
    command.add_option("OUT", values.output, "a .ply or .drc file")->required()->type_name("FILE");
    command.add_option("-n,--points", values.synthetic.points, "exactly so many; 1000000")
        ->type_name("N")
        ->transform(point_count());
    command.add_option("--seed", values.synthetic.seed, "another seed, other samples; 1")
        ->type_name("S")
        ->transform(whole_number());
    command.add_option("--noise", values.synthetic.noise, "standard deviation in mm; 0.08")
        ->type_name("D")
        ->transform(real_number("a length of at least 0, in mm, as in 0.08"));
    add_draco(command, values);
    add_ply(command, values);
    add_common(command, values);
    command.footer("Example:\n  stipple synthesize ammonite.ply --points 500000 --seed 7");
    return command;
}

}  // namespace stipple::cli
