#include "cli/command_line.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <map>
#include <sstream>

namespace stipple::cli {
namespace {

template <typename T>
T parsed(const std::vector<std::string>& arguments) {
    return std::get<T>(parse_command_line(arguments));
}

std::string refusal(const std::vector<std::string>& arguments) {
    try {
        parse_command_line(arguments);
    } catch (const UsageError& error) {
        return error.what();
    }
    return "accepted";
}

TEST(CommandLine, SimplifyTakesTheFormThatMeasurementsRelyOn) {
    const auto command = parsed<SimplifyCommand>({"simplify", "in.ply", "out.drc", "--method",
                                                  "hierarchical", "--points", "5000", "--threads",
                                                  "2", "--seed", "9", "--json", "f.json"});
    EXPECT_EQ(command.input, "in.ply");
    EXPECT_EQ(command.job.options.points, 5000U);
    EXPECT_EQ(command.job.options.seed, 9U);
    EXPECT_EQ(command.job.output.formats, std::vector{CloudFormat::Draco});
    EXPECT_EQ(command.common.threads, 2U);
    EXPECT_EQ(command.common.json, "f.json");
}

TEST(CommandLine, TheDefaultMethodIsThatOfCore) {
    const auto command = parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-n", "5"});
    EXPECT_EQ(command.job.options.method, Method::Multiphase);
    EXPECT_EQ(command.job.added.splats, SplatAttributes::Radius);
    EXPECT_FALSE(command.job.added.source_index);
}

TEST(CommandLine, RemovesOutliersWithOrWithoutAValue) {
    const auto deviations = [](const std::vector<std::string>& words) -> std::optional<double> {
        const auto command = parsed<SimplifyCommand>(words);
        EXPECT_EQ(command.input, "i.ply");
        EXPECT_EQ(command.output, "o.ply");
        if (!command.job.outliers) return std::nullopt;
        return command.job.outliers->deviations;
    };
    EXPECT_EQ(deviations({"simplify", "i.ply", "o.ply", "-n", "5"}), std::nullopt);
    EXPECT_EQ(deviations({"simplify", "--remove-outliers", "i.ply", "o.ply", "-n", "5"}), 2.5);
    EXPECT_EQ(deviations({"simplify", "i.ply", "o.ply", "-n", "5", "--remove-outliers"}), 2.5);
    EXPECT_EQ(deviations({"simplify", "--remove-outliers", "2", "i.ply", "o.ply", "-n", "5"}), 2);
    EXPECT_EQ(deviations({"simplify", "i.ply", "--remove-outliers=4", "o.ply", "-n", "5"}), 4);
    EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--remove-outliers", "0.5"}),
              "--remove-outliers 0.5: expected 1..100 standard deviations");
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--remove-outliers=few"})
                  .find("few: expected standard deviations, 1..100"),
              std::string::npos);
    EXPECT_TRUE(
        parsed<PyramidCommand>({"pyramid", "i.ply", "o", "--remove-outliers"}).job.outliers);
    EXPECT_TRUE(
        parsed<PyramidCommand>({"pyramid", "i.ply", "o", "--layout", "potree", "--remove-outliers"})
            .job.outliers);
    EXPECT_TRUE(parsed<CurveCommand>({"curve", "i.ply", "--remove-outliers"}).job.outliers);
    EXPECT_TRUE(
        parsed<AnalyzeCommand>({"analyze", "i.ply", "o.ply", "--remove-outliers"}).job.outliers);
    EXPECT_TRUE(
        parsed<UpsampleCommand>({"upsample", "i.ply", "o.ply", "-r", "2", "--remove-outliers"})
            .job.outliers);
}

TEST(CommandLine, SimplifyTakesTheOptionsOfTheContraction) {
    const auto command =
        parsed<SimplifyCommand>({"simplify", "--oversampling", "8", "--k", "12", "--placement",
                                 "end-point", "--max-displacement", "0.5", "--color-weight", "0.25",
                                 "--attribute-weight", "a=b=2", "i.ply", "o.ply", "-n", "5"});
    const SimplifyOptions& options = command.job.options;
    EXPECT_EQ(options.oversampling, 8);
    EXPECT_EQ(options.iterative.k, 12U);
    EXPECT_EQ(options.iterative.placement, Placement::EndPoint);
    EXPECT_EQ(options.iterative.max_displacement, 0.5);
    EXPECT_EQ(options.iterative.color_weight, 0.25);
    EXPECT_EQ(options.iterative.attribute_weights.at("a=b"), 2);
}

TEST(CommandLine, SimplifyTakesTheOptionsOfTheClusterings) {
    for (const Method method : {Method::Hierarchical, Method::Incremental}) {
        const std::string name(to_string(method));
        const SimplifyOptions options =
            parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-m", name, "--max-variation",
                                     "0.1", "--max-cluster-size", "7", "--representative",
                                     "centroid"})
                .job.options;
        EXPECT_EQ(options.method, method);
        EXPECT_EQ(options.hierarchical.max_variation, 0.1);
        EXPECT_EQ(options.incremental.max_cluster_size, 7U);
        EXPECT_EQ(options.incremental.representative, Representative::Centroid);
    }
    EXPECT_EQ(parsed<SimplifyCommand>(
                  {"simplify", "i.ply", "o.ply", "-m", "voxel", "--voxel-size", "0.5"})
                  .job.options.voxel.voxel_size,
              0.5);
}

TEST(CommandLine, RegionsAreSpheresBoxesAndRangesOfAnAttribute) {
    const auto command = parsed<SimplifyCommand>({"simplify",
                                                  "i.ply",
                                                  "o.ply",
                                                  "-n",
                                                  "5",
                                                  "-m",
                                                  "particles",
                                                  "--region",
                                                  "sphere:1,-2e3,3,0.5:4",
                                                  "--region",
                                                  "box:-1,-1,-1,1,1,1:0.5:0.25",
                                                  "--region",
                                                  "attribute:a:b,c,-1,2:8",
                                                  "--adaptivity",
                                                  "1",
                                                  "--max-grading",
                                                  "2",
                                                  "--max-iterations",
                                                  "9",
                                                  "--tolerance",
                                                  "0.1"});
    const ParticleSimulationOptions& options = command.job.options.particles;
    EXPECT_EQ(options.adaptivity, 1);
    EXPECT_EQ(options.max_grading, 2);
    EXPECT_EQ(options.max_iterations, 9U);
    EXPECT_EQ(options.tolerance, 0.1);
    ASSERT_EQ(options.regions.size(), 3U);
    EXPECT_EQ(std::get<DensityRegion::Sphere>(options.regions[0].where).center, Vec3d(1, -2e3, 3));
    EXPECT_EQ(options.regions[0].density, 4);
    EXPECT_EQ(options.regions[0].transition, 0);
    EXPECT_EQ(std::get<DensityRegion::Box>(options.regions[1].where).min, Vec3d(-1, -1, -1));
    EXPECT_EQ(options.regions[1].transition, 0.25);
    const auto& scalar = std::get<DensityRegion::Scalar>(options.regions[2].where);
    EXPECT_EQ(scalar.attribute, "a:b,c");
    EXPECT_EQ(scalar.low, -1);
    EXPECT_EQ(scalar.high, 2);
}

TEST(CommandLine, AnOptionOfAnotherMethodIsRefusedWithItsOwners) {
    EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "-m", "voxel", "--k", "8"}),
              "--k belongs to multiphase and iterative, not to voxel");
    EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "--max-variation", "0.1"}),
              "--max-variation belongs to hierarchical and incremental, not to multiphase");
    // Every field that only some methods have is an option, and is refused where it has no meaning.
    const std::map<std::string, std::string> values = {{"placement", "optimal"},
                                                       {"representative", "nearest"},
                                                       {"regions", "sphere:0,0,0,1:1"},
                                                       {"attribute_weights", "a=1"},
                                                       {"reductions", "a=max"}};
    for (const proto::MethodField& field : proto::method_fields()) {
        std::string option = "--" + std::string(field.name);
        std::replace(option.begin(), option.end(), '_', '-');
        if (field.name == "regions") option = "--region";
        if (field.name == "reductions") option = "--reduce";
        if (field.name == "attribute_weights") option = "--attribute-weight";
        const auto value = values.find(std::string(field.name));
        EXPECT_TRUE(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "-m", "random", option,
                             value == values.end() ? "1" : value->second})
                        .starts_with(option + " belongs to "))
            << option;
    }
}

TEST(CommandLine, UpsampleTakesMorePointsOrARatioAboveOne) {
    const auto command = parsed<UpsampleCommand>(
        {"upsample", "i.ply", "o.ply", "--ratio", "4", "--seed", "3", "--splats", "none"});
    EXPECT_EQ(command.job.options.ratio, 4);
    EXPECT_EQ(command.job.options.particles.seed, 3U);
    EXPECT_EQ(command.job.added.splats, SplatAttributes::None);
    EXPECT_NE(refusal({"upsample", "i.ply", "o.ply"}).find("--ratio"), std::string::npos);
    EXPECT_NE(refusal({"upsample", "i.ply", "o.ply", "-r", "0.5"}).find("ratio 0.5"),
              std::string::npos);
}

TEST(CommandLine, AnalyzeTakesNeighboursAndTheSignsOfNormals) {
    const auto plain = parsed<AnalyzeCommand>({"analyze", "i.ply", "o.ply"});
    EXPECT_EQ(plain.job.options.k, 0U);
    EXPECT_EQ(plain.job.options.signs, NormalSigns::SpanningTree);
    EXPECT_EQ(
        parsed<AnalyzeCommand>({"analyze", "i.ply", "o.ply", "--orient", "none"}).job.options.signs,
        NormalSigns::Any);
    const auto viewed =
        parsed<AnalyzeCommand>({"analyze", "i.ply", "o.ply", "--k", "0", "--viewpoint", "-1,2,3"});
    EXPECT_EQ(viewed.job.options.k, 0U);
    EXPECT_EQ(viewed.job.options.viewpoint, Vec3d(-1, 2, 3));
    EXPECT_FALSE(plain.job.options.feature_lines);
    const auto lines = parsed<AnalyzeCommand>(
        {"analyze", "i.ply", "o.ply", "--feature-lines", "l.ply", "--feature-variation", "0.1"});
    EXPECT_EQ(lines.feature_lines, "l.ply");
    EXPECT_EQ(lines.job.options.feature_lines->variation, 0.1);
    EXPECT_NE(refusal({"analyze", "i.ply", "o.ply", "--feature-variation", "0.1"}), "accepted");
    EXPECT_NE(refusal({"analyze", "i.ply", "o.ply", "--k", "2"}).find("k 2"), std::string::npos);
    EXPECT_NE(refusal({"analyze", "i.ply", "o.ply", "--viewpoint", "1,2"}).find("X,Y,Z"),
              std::string::npos);
}

TEST(CommandLine, EvaluateTakesAReferenceCandidatesAndWhatToWrite) {
    const auto command = parsed<EvaluateCommand>(
        {"evaluate", "a.ply",     "b.ply",     "c.drc",   "--map",     "m.png",        "--map",
         "m.ply",    "--samples", "5000",      "--basis", "quadratic", "--attributes", "--range",
         "0.5",      "--views",   "front,top", "--up",    "z",         "--json",       "-"});
    EXPECT_EQ(command.candidates.size(), 2U);
    EXPECT_EQ(command.maps.size(), 2U);
    const proto::EvaluationOptions& options = command.job.options;
    EXPECT_TRUE(options.pictures);
    EXPECT_EQ(command.job.output.formats, std::vector{CloudFormat::Ply});
    EXPECT_EQ(options.measure.samples, 5000U);
    EXPECT_EQ(options.measure.surface, ErrorSurface::Quadratic);
    EXPECT_TRUE(options.measure.attributes);
    EXPECT_EQ(options.range, 0.5);
    EXPECT_EQ(options.views, (std::vector<std::string>{"front", "top"}));
    EXPECT_EQ(options.up, 'z');
    EXPECT_EQ(options.labels, (std::vector<std::string>{"b.ply", "c.drc"}));
    EXPECT_EQ(refusal({"evaluate", "a.ply", "b.ply", "--quadratic"}),
              "--quadratic: no such option (see --help)");
}

TEST(CommandLine, LabelsOfCandidatesAreUtf8OfAtMost200Bytes) {
    std::string name;
    for (int i = 0; i < 70; ++i) name += "点";  // 210 bytes
    const auto labels =
        parsed<EvaluateCommand>({"evaluate", "a.ply", name + ".ply", "scan_\xe9.ply"})
            .job.options.labels;
    EXPECT_EQ(labels, (std::vector<std::string>{name.substr(0, 198), "scan_\xef\xbf\xbd.ply"}));
}

TEST(CommandLine, DashIsStandardOutputForTheFigures) {
    EXPECT_EQ(parsed<InspectCommand>({"inspect", "in.ply", "--json", "-"}).common.json, "-");
}

TEST(CommandLine, PyramidTakesEveryMethodWithItsOwnOptions) {
    for (const Method method : kMethods) {
        const std::string name(to_string(method));
        EXPECT_EQ(parsed<PyramidCommand>({"pyramid", "in.ply", "out", "-m", name})
                      .job.options.simplification.method,
                  method);
    }
    const auto particles = parsed<PyramidCommand>(
        {"pyramid", "in.ply", "out", "-m", "particles", "--adaptivity", "0.5", "--seed", "7"});
    EXPECT_EQ(particles.job.options.simplification.particles.adaptivity, 0.5);
    EXPECT_EQ(particles.job.options.simplification.seed, 7U);
    EXPECT_NE(refusal({"pyramid", "in.ply", "out", "--adaptivity", "0.5"}), "accepted");
    EXPECT_EQ(refusal({"pyramid", "in.ply", "out", "--max-cluster-size", "9"}),
              "--max-cluster-size: levels have counts instead; remove it");
    EXPECT_EQ(refusal({"pyramid", "in.ply", "out", "-m", "voxel", "--voxel-size", "1"}),
              "--voxel-size: levels have counts instead; remove it");
    EXPECT_EQ(refusal({"pyramid", "in.ply", "out", "-m", "incremental", "--max-variation", "0.1"}),
              "accepted");
}

TEST(CommandLine, PyramidTakesALadderOrARatio) {
    const auto ladder = parsed<PyramidCommand>({"pyramid", "in.ply", "out", "--levels", "10,100"});
    EXPECT_EQ(ladder.job.options.sizes, (std::vector<std::uint64_t>{10, 100}));
    const auto ratio =
        parsed<PyramidCommand>({"pyramid", "in.ply", "out", "--ratio", "2", "--base-points", "50"});
    EXPECT_EQ(ratio.job.options.ratio, 2.0);
    EXPECT_EQ(ratio.job.options.base_points, 50U);
    EXPECT_EQ(ratio.job.output.formats.size(), 3U);
    EXPECT_NE(refusal({"pyramid", "in.ply", "out", "--levels", "10", "--ratio", "2"}), "accepted");
    EXPECT_EQ(ratio.job.options.simplification.method, Method::Hierarchical);
    const auto added = parsed<PyramidCommand>(
        {"pyramid", "in.ply", "out", "--refine", "add", "--base-bytes", "15kB"});
    EXPECT_TRUE(added.job.options.nested);
    EXPECT_EQ(added.job.options.simplification.method, Method::Iterative);
    EXPECT_EQ(added.job.base_bytes, 15'000U);
    EXPECT_NE(refusal({"pyramid", "in.ply", "out", "--refine", "more"}), "accepted");
    EXPECT_NE(refusal({"pyramid", "in.ply", "out", "--refine", "add", "-m", "multiphase"}),
              "accepted");
    EXPECT_NE(
        refusal({"pyramid", "in.ply", "out", "-m", "iterative", "--representative", "nearest"})
            .find("belongs to hierarchical"),
        std::string::npos);
}

TEST(CommandLine, APotreeFolderTakesNoOptionOfLevels) {
    const auto command = parsed<PyramidCommand>({"pyramid", "in.ply", "out", "--layout", "potree"});
    EXPECT_TRUE(command.potree);
    EXPECT_EQ(command.job.output.formats, std::vector{CloudFormat::Ply});
    EXPECT_EQ(refusal({"pyramid", "in.ply", "out", "--layout", "potree", "--ratio", "2"}),
              "--ratio cannot be combined with --layout potree");
    EXPECT_EQ(refusal({"pyramid", "in.ply", "out", "--layout", "copc"}),
              "--layout copc: expected levels or potree; COPC is one file: stipple convert IN "
              "OUT.copc.laz");
    EXPECT_EQ(refusal({"pyramid", "in.ply", "out", "--layout", "ept"}),
              "--layout ept: expected levels or potree");
}

TEST(CommandLine, ConvertGoesByTheEndOfTheName) {
    for (const char* const name : {"a.ply", "a.drc", "a.stpc", "a.laz", "a.copc.laz"})
        EXPECT_EQ(parsed<ConvertCommand>({"convert", "in.ply", name}).output, name);
    const auto placed = parsed<ConvertCommand>(
        {"convert", "in.ply", "a.laz", "--epsg", "32633", "--precision", "0.01"});
    EXPECT_EQ(placed.copc.epsg, 32633U);
    EXPECT_EQ(placed.copc.precision, 0.01);
    EXPECT_EQ(refusal({"convert", "in.ply", "a.drc", "--epsg", "32633"}),
              "--epsg: belongs to .laz, not to .drc: omit it, or change the ending of OUT");
    EXPECT_NE(refusal({"convert", "in.ply", "a.laz", "--epsg", "4326"}).find("epsg 4326"),
              std::string::npos);
    EXPECT_EQ(refusal({"convert", "in.ply", "a.las"}),
              "a.las: the name must end with .ply, .drc, .stpc or .laz");
    EXPECT_NE(parsed<InfoCommand>({"convert", "--help"}).text.find(".ply, .drc, .stpc or .laz"),
              std::string::npos);
}

TEST(CommandLine, SliceTakesOneBudgetAndABox) {
    const auto command = parsed<SliceCommand>(
        {"slice", "levels", "out.glb", "--points", "100", "--box", "0,-1,0,1,1,2.5"});
    EXPECT_EQ(command.options.points, 100U);
    EXPECT_EQ(command.options.format, CloudFormat::Glb);
    ASSERT_TRUE(command.options.box);
    EXPECT_EQ(command.options.box->min, Vec3d(0, -1, 0));
    EXPECT_EQ(command.options.box->max, Vec3d(1, 1, 2.5));
    EXPECT_EQ(parsed<SliceCommand>({"slice", "levels", "out.drc", "--max-error", "0.5"})
                  .options.max_error,
              0.5);
    EXPECT_EQ(parsed<SliceCommand>({"slice", "levels", "out.drc", "--max-error", "0.5%"})
                  .options.max_error_rel,
              0.005);
    EXPECT_NE(refusal({"slice", "levels", "out.ply"}), "accepted");
    EXPECT_NE(refusal({"slice", "levels", "out.ply", "--points", "1", "--bytes", "1"}), "accepted");
    EXPECT_NE(refusal({"slice", "levels", "out.ply", "--points", "1", "--box", "1,2"}), "accepted");
    EXPECT_NE(refusal({"slice", "levels", "out.ply", "--points", "1", "--box", "1,0,0,0,1,1"})
                  .find("box"),
              std::string::npos);
}

TEST(CommandLine, ReductionsAreByName) {
    const auto command =
        parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-n", "5", "--reduce",
                                 "intensity=max", "--reduce", "label=mode"});
    EXPECT_EQ(command.job.options.reductions.at("intensity"), Reduction::Max);
    EXPECT_EQ(command.job.options.reductions.at("label"), Reduction::Mode);
}

TEST(CommandLine, MaxErrorIsALengthOrAPartOfTheDiagonal) {
    const auto length =
        parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "--max-error", "0.1"});
    EXPECT_EQ(length.job.options.max_error, 0.1);
    EXPECT_FALSE(length.job.options.max_error_rel);
    const auto part =
        parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "--max-error", "0.5%"});
    EXPECT_EQ(part.job.options.max_error_rel, 0.005);
    EXPECT_FALSE(part.job.options.max_error);
}

TEST(CommandLine, ACurveIsAtCountsOrAtSoMany) {
    const auto at = parsed<CurveCommand>(
        {"curve", "i.ply", "-m", "iterative", "--points", "500,100", "--plot", "c.svg"});
    EXPECT_EQ(at.job.options.points, (std::vector<std::uint64_t>{100, 500}));
    EXPECT_EQ(at.job.options.simplification.method, Method::Iterative);
    EXPECT_EQ(at.plot, "c.svg");
    EXPECT_EQ(parsed<CurveCommand>({"curve", "i.ply", "--count", "9"}).job.options.count, 9U);
    EXPECT_NE(refusal({"curve", "i.ply", "--plot", "c.png"}).find(".svg"), std::string::npos);
    for (const std::string method : {"voxel", "random"})
        EXPECT_TRUE(refusal({"curve", "i.ply", "-m", method})
                        .starts_with("--method " + method + ": expected"));
    EXPECT_NE(refusal({"curve", "i.ply", "--count", "1"}).find("2..64"), std::string::npos);
}

TEST(CommandLine, RefusesAMaxErrorThatNoCloudCanKeep) {
    for (const char* const value : {"0", "-1", "0%", "nan", "inf", "1km", "%"})
        EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "--max-error", value}).find("--max-error"),
                  std::string::npos)
            << value;
}

TEST(CommandLine, MaxErrorNamesTheMethodsThatHaveIt) {
    for (const char* const method : {"voxel", "random", "incremental"}) {
        const std::string message =
            refusal({"simplify", "i.ply", "o.ply", "--max-error", "1", "-m", method});
        EXPECT_NE(message.find(method), std::string::npos);
        EXPECT_NE(message.find("multiphase, hierarchical, iterative or particles"),
                  std::string::npos);
    }
}

TEST(CommandLine, RefusesWhatCannotBeDoneByNameAndValue) {
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply"}).find("--points"), std::string::npos);
    EXPECT_NE(refusal({"simplify", "i.ply", "o.xyz", "-n", "5"}).find("o.xyz"), std::string::npos);
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "-n", "0"}).find("points 0"),
              std::string::npos);
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "-r", "0.5"}), "accepted");
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--method", "magic"}).find("magic"),
              std::string::npos);
    EXPECT_NE(
        refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--reduce", "=max"}).find("NAME=POLICY"),
        std::string::npos);
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--api-key", "k"}).find("--server"),
              std::string::npos);
    for (const char* region : {"sphere:1,2,3:4", "sphere:1,2,3,x:4", "cone:1,2,3,4:5", "box:4",
                               "attribute:a,1:2", "sphere:1,2,3,4", "sphere:1,2,3,4:5:6:7"}) {
        EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "-m", "particles", "--region",
                           region})
                      .find(std::string("--region ") + region + ": expected"),
                  std::string::npos);
    }
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--attribute-weight", "a"})
                  .find("NAME=W"),
              std::string::npos);
    EXPECT_NE(
        refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--splats", "disc"}).find("ellipse"),
        std::string::npos);
    EXPECT_EQ(refusal({"evaluate", "a.ply", "b.ply", "--basis", "cubic"}),
              "--basis \"cubic\": expected one of linear, quadratic, samples");
    EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--reduce", "a=sum"}),
              "--reduce \"sum\": expected one of mean, nearest, min, max, mode");
    EXPECT_EQ(refusal({"analyze", "i.ply", "o.ply", "--orient", "viewpoint"}),
              "--orient viewpoint: give --viewpoint X,Y,Z instead");
}

TEST(CommandLine, AnUnknownCommandIsToldThoseThereAre) {
    const std::string message = refusal({"simplfy", "i.ply", "o.ply", "-n", "5"});
    EXPECT_TRUE(message.starts_with("simplfy: no such command: expected one of ")) << message;
    EXPECT_NE(message.find("simplify"), std::string::npos) << message;
}

TEST(CommandLine, AnUnknownOptionIsToldTheOneNearIt) {
    EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "--pionts", "5000"}),
              "--pionts: no such option: did you mean --points?");
    EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "--max-eror=1%"}),
              "--max-eror: no such option: did you mean --max-error?");
    EXPECT_EQ(refusal({"slice", "levels", "o.ply", "--bites", "5"}),
              "--bites: no such option: did you mean --bytes?");
    EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "--verbose", "-n", "5"}),
              "--verbose: no such option (see --help)");
    EXPECT_EQ(refusal({"curve", "i.ply", "--voxel-sise", "5"}),  // it has no --voxel-size either
              "--voxel-sise: no such option (see --help)");
    EXPECT_EQ(refusal({"--versoin"}), "--versoin: no such option: did you mean --version?");
}

TEST(CommandLine, WholeNumbersAreDecimalWithoutASign) {
    const std::map<std::string, std::vector<std::string>> options = {
        {"--points", {"simplify", "i.ply", "o.ply"}},
        {"--seed", {"simplify", "i.ply", "o.ply", "-n", "5"}},
        {"--threads", {"simplify", "i.ply", "o.ply", "-n", "5"}},
        {"--max-cluster-size", {"simplify", "i.ply", "o.ply", "-m", "hierarchical"}},
        {"--levels", {"pyramid", "i.ply", "o"}},
        {"--base-points", {"pyramid", "i.ply", "o"}},
        {"--base-bytes", {"pyramid", "i.ply", "o"}},
        {"--tile-points", {"pyramid", "i.ply", "o"}},
        {"--bytes", {"slice", "p", "o.ply"}},
        {"--samples", {"evaluate", "i.ply", "o.ply"}},
        {"--count", {"curve", "i.ply"}}};
    for (const auto& [option, command] : options) {
        for (const char* value : {"-3", "36893488147419103232", "x"}) {  // 2^65
            std::vector<std::string> arguments = command;
            arguments.insert(arguments.end(), {option, value});
            const std::string message = refusal(arguments);
            EXPECT_NE(message.find(option), std::string::npos) << message;
            EXPECT_NE(message.find(value), std::string::npos) << message;
        }
    }
    EXPECT_EQ(
        parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-n", "0100"}).job.options.points,
        100U);
    EXPECT_EQ(
        parsed<PyramidCommand>({"pyramid", "i.ply", "o", "--base-bytes", "15kB"}).job.base_bytes,
        15'000U);
}

TEST(CommandLine, ASharePerCentIsNotRounded) {
    const auto ratio = [](const char* text) {
        return parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-r", text})
            .job.options.ratio;
    };
    EXPECT_EQ(ratio("0.123456789"), 0.123456789);
    EXPECT_EQ(ratio("12.3456789%"), 12.3456789 / 100);
    EXPECT_EQ(ratio("1e-7%"), 1e-7 / 100);
}

TEST(CommandLine, NothingFollowsAWholeNumber) {
    for (const std::string value : {"5k", "1e3", "1.5"}) {
        EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--seed", value}),
                  "--seed: " + value + ": expected a whole number, as in 5000 (see --help)");
    }
}

TEST(CommandLine, PointsAreCountedInThousandsAndMillionsToo) {
    const auto points = [](const char* text) {
        return parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-n", text})
            .job.options.points;
    };
    EXPECT_EQ(points("10k"), 10'000U);
    EXPECT_EQ(points("1.001k"), 1'001U);
    EXPECT_EQ(points("1.5M"), 1'500'000U);
    EXPECT_EQ(points("18446744073709551615"), UINT64_MAX);
    EXPECT_EQ(parsed<PyramidCommand>({"pyramid", "i.ply", "o", "--levels", "500,1k,2.5k"})
                  .job.options.sizes,
              (std::vector<std::uint64_t>{500, 1'000, 2'500}));
    EXPECT_EQ(points("1e3"), 1'000U);
    EXPECT_EQ(points("1.25E+6"), 1'250'000U);
    for (const std::string value :
         {"1e-3", "1.5e0", "e3", "1e", "1e30", "-1e3", "1.5", "1e3k", "0.0001k", "0k", "5K", "5m",
          "5 k", "k", "5kB", "nank", "infM", "99999999999999M", "-5k"}) {
        EXPECT_EQ(
            refusal({"simplify", "i.ply", "o.ply", "--points=" + value}),
            "--points: " + value + ": expected points, as in 5000, 10k, 1.5M or 1e6 (see --help)");
    }
}

TEST(CommandLine, TellsTheOptionsOfWhichOneSaysHowManyPoints) {
    const std::vector<std::string> simplify = {"simplify", "i.ply", "o.ply", "-n", "5"};
    const auto refused = [&](std::vector<std::string> more) {
        more.insert(more.begin(), simplify.begin(), simplify.end());
        return refusal(more);
    };
    EXPECT_EQ(refused({"-m", "voxel", "--voxel-size", "0.1"}),
              "--points N, --ratio R or --voxel-size S: give one of them");
    for (const std::string bound : {"--max-cluster-size=9", "--max-variation=0.1"})
        EXPECT_EQ(refused({"-m", "hierarchical", bound}),
                  "--points N, --ratio R, --max-error E, or --max-cluster-size N and "
                  "--max-variation S: give one of them");
    EXPECT_EQ(refused({"--ratio", "0.5"}),
              "--points N, --ratio R or --max-error E: give one of them");
    EXPECT_EQ(refused({"-m", "incremental", "--max-variation", "0.1"}), "accepted");
}

TEST(CommandLine, RefusesBitsAndPrecisionsThatNoFileHas) {
    const std::string bits = ": expected 1..30, or 0: exact floats (see --help)";
    const std::vector<std::vector<std::string>> commands = {
        {"simplify", "i.ply", "o.drc", "-n", "5"},
        {"convert", "i.ply", "o.drc"},
        {"pyramid", "i.ply", "o"}};
    for (const std::vector<std::string>& command : commands) {
        const auto refused = [&](const std::string& option, const std::string& value) {
            std::vector<std::string> arguments = command;
            arguments.insert(arguments.end(), {option, value});
            return refusal(arguments);
        };
        EXPECT_EQ(refused("--position-bits", "31"), "--position-bits: 31" + bits);
        EXPECT_EQ(refused("--attribute-bits", "31"), "--attribute-bits: 31" + bits);
        for (const std::string value : {"0", "1", "31"})
            EXPECT_EQ(refused("--normal-bits", value),
                      "--normal-bits: " + value + ": expected 2..30 (see --help)");
        for (const std::string value : {"0", "-1", "nan", "inf", "", "1m"})
            EXPECT_EQ(refused("--precision", value),
                      "--precision: " + value +
                          ": expected a length above 0, in input units, as in 0.001 (see --help)");
        for (const char* const option : {"--position-bits", "--attribute-bits"})
            EXPECT_EQ(refused(option, "0"), "accepted");
    }
}

TEST(CommandLine, AttributesHaveBitsOfTheirOwn) {
    const auto command =
        parsed<SimplifyCommand>({"simplify", "i.ply", "o.drc", "-n", "5", "--attribute-bits", "9"});
    EXPECT_EQ(command.job.output.draco.attribute_bits, 9U);
    EXPECT_EQ(parsed<ConvertCommand>({"convert", "i.ply", "o.drc"}).draco.attribute_bits,
              DracoEncodeOptions{}.attribute_bits);
    EXPECT_TRUE(refusal({"convert", "i.ply", "o.ply", "--attribute-bits", "9"})
                    .starts_with("--attribute-bits: belongs to .drc, not to .ply"));
}

TEST(CommandLine, ARefusedNumberIsToldTheLimit) {
    for (const std::string value : {"abc", ""})
        EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--oversampling", value}),
                  "--oversampling: " + value +
                      ": expected clusters per point, 1..1000, as in 3 (see --help)");
    EXPECT_EQ(refusal({"upsample", "i.ply", "o.ply", "--ratio", "200%"}),
              "--ratio: 200%: expected a factor above 1, as in 2 (see --help)");
    EXPECT_EQ(refusal({"pyramid", "i.ply", "o", "--ratio", "25%"}),
              "--ratio: 25%: expected a factor in (1, 64], as in 4 (see --help)");
    EXPECT_EQ(refusal({"upsample", "i.ply", "o.ply", "-n", "5", "--max-iterations", "99999999999"}),
              "--max-iterations: 99999999999: expected a whole number, 1..4294967295 (see --help)");
}

TEST(CommandLine, ThreadsHaveALimit) {
    EXPECT_EQ(parsed<InspectCommand>({"inspect", "i.ply", "--threads", "1024"}).common.threads,
              1024U);
    EXPECT_NE(refusal({"inspect", "i.ply", "--threads", "1025"}).find("0 to 1024"),
              std::string::npos);
}

TEST(CommandLine, RefusesOptionsOfAnotherFormat) {
    EXPECT_EQ(
        refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--position-bits", "12"}),
        "--position-bits: belongs to .drc, not to .ply: omit it, or change the ending of OUT");
    EXPECT_EQ(refusal({"evaluate", "a.ply", "b.ply", "--map", "e.ply", "--views", "top"}),
              "--views: belongs to .png: omit it, or add a --map that ends with .png");
    EXPECT_NE(refusal({"evaluate", "a.ply", "b.ply", "--position-bits", "12"}).find(".drc"),
              std::string::npos);
    EXPECT_EQ(refusal({"evaluate", "a.ply", "b.ply", "--map", "e.drc", "--map", "e.png", "--up",
                       "y", "--position-bits", "12"}),
              "accepted");
    EXPECT_NE(refusal({"convert", "i.ply", "o.drc", "--ply-encoding", "ascii"}).find(".ply"),
              std::string::npos);
    EXPECT_EQ(parsed<ConvertCommand>({"convert", "i.ply", "o.stpc", "--precision", "0.1"}).output,
              "o.stpc");
}

TEST(CommandLine, HelpOfACurveHasNoTargets) {
    const std::string text = parsed<InfoCommand>({"curve", "--help"}).text;
    EXPECT_NE(text.find("--representative"), std::string::npos);
    EXPECT_EQ(text.find("--max-cluster-size"), std::string::npos);
    EXPECT_EQ(text.find("--voxel-size"), std::string::npos);
}

TEST(CommandLine, HelpFitsATerminalOf80Columns) {
    std::vector<std::vector<std::string>> asked = {{"--help"}};
    for (const char* command : {"simplify", "upsample", "analyze", "curve", "pyramid", "slice",
                                "evaluate", "inspect", "convert", "synthesize"})
        asked.push_back({command, "--help"});
    for (const std::vector<std::string>& arguments : asked) {
        std::istringstream lines(parsed<InfoCommand>(arguments).text);
        for (std::string line; std::getline(lines, line);) EXPECT_LE(line.size(), 80U) << line;
    }
}

TEST(CommandLine, HelpIsACommandToo) {
    EXPECT_EQ(parsed<InfoCommand>({"help"}).text, parsed<InfoCommand>({"--help"}).text);
    EXPECT_EQ(parsed<InfoCommand>({"help", "slice"}).text,
              parsed<InfoCommand>({"slice", "--help"}).text);
    EXPECT_TRUE(refusal({"help", "sliec"}).starts_with("sliec: no such command"));
}

TEST(CommandLine, HelpOfASliceSaysThatOneBudgetIsWanted) {
    const std::string text = parsed<InfoCommand>({"slice", "--help"}).text;
    const std::size_t budgets = text.find("\nBudget (give one):\n  -n,--points N");
    EXPECT_NE(budgets, text.npos) << text;
    EXPECT_NE(text.find("\n  --max-error E", budgets), text.npos) << text;
    EXPECT_EQ(text.find('['), text.find("[OPTIONS]")) << text;  // nothing in CLI11's own words
}

TEST(CommandLine, HelpGroupsOptionsUnderTheMethodsThatHaveThem) {
    const auto group_of = [](const char* command, const std::string& option) {
        std::istringstream lines(parsed<InfoCommand>({command, "--help"}).text);
        std::string group;
        for (std::string line; std::getline(lines, line);) {
            if (line.starts_with("  " + option + ' ')) return group;
            if (!line.starts_with(' ') && line.ends_with(':')) group = line;
        }
        return std::string();
    };
    EXPECT_EQ(group_of("simplify", "--max-cluster-size"), "For hierarchical and incremental:");
    EXPECT_EQ(group_of("simplify", "--max-variation"), "For hierarchical and incremental:");
    EXPECT_EQ(group_of("simplify", "--voxel-size"), "For voxel:");
    EXPECT_EQ(group_of("simplify", "--representative"), "For hierarchical, incremental and voxel:");
    EXPECT_EQ(group_of("simplify", "--reduce"), "Options:");
    EXPECT_EQ(group_of("curve", "--representative"), "For hierarchical:");
    EXPECT_EQ(group_of("curve", "--adaptivity"), "For particles:");
    EXPECT_EQ(group_of("pyramid", "--max-variation"), "For incremental:");
}

TEST(CommandLine, HelpOfACommandShowsExamples) {
    for (const char* command :
         {"simplify", "upsample", "analyze", "pyramid", "inspect", "convert", "synthesize"}) {
        const std::string text = parsed<InfoCommand>({command, "--help"}).text;
        EXPECT_NE(text.find(std::string("stipple ") + command), std::string::npos) << text;
        EXPECT_NE(text.find("Example"), std::string::npos);
    }
}

}  // namespace
}  // namespace stipple::cli
