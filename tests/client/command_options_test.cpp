// What each command takes.
#include "parsed_command.hpp"

#include <gtest/gtest.h>
#include <cstdint>
#include <optional>

namespace stipple::cli {
namespace {

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
    EXPECT_EQ(refusal({"analyze", "i.ply", "o.ply", "--feature-lines", "l.ply",
                       "--feature-variation", "2"}),
              "--feature-variation 2: expected above 0, below 1/3");
    EXPECT_NE(refusal({"analyze", "i.ply", "o.ply", "--k", "2"}).find("k 2"), std::string::npos);
    EXPECT_NE(refusal({"analyze", "i.ply", "o.ply", "--viewpoint", "1,2"}).find("X,Y,Z"),
              std::string::npos);
}

TEST(CommandLine, SynthesizeRefusesWhatNoScanHas) {
    EXPECT_EQ(refusal({"synthesize", "o.ply", "--points", "0"}),
              "--points 0: expected 1..4294967295");
    EXPECT_EQ(refusal({"synthesize", "o.ply", "--noise", "11"}), "--noise 11: expected 0..10 mm");
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

TEST(CommandLine, APyramidRefusesWhatNoneOfItsFormatsTakes) {
    const auto refused = [](const char* option, const char* value, const char* formats) {
        return refusal({"pyramid", "in.ply", "out", "--formats", formats, option, value});
    };
    EXPECT_EQ(refused("--tile-bits", "9", "drc,ply"),
              "--tile-bits: no format of --formats takes it: omit it, or add glb");
    EXPECT_EQ(refused("--coding", "kd-tree", "glb"),
              "--coding: no format of --formats takes it: omit it, or add drc");
    EXPECT_EQ(refused("--epsg", "32633", "stpc"),
              "--epsg: no format of --formats takes it: omit it, or add glb or copc.laz");
    EXPECT_EQ(refused("--precision", "0.1", "stpc"), "accepted");
    EXPECT_EQ(refusal({"pyramid", "in.ply", "out", "--tile-bits", "9", "--precision", "0.1"}),
              "--tile-bits excludes --precision (see --help)");
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
    EXPECT_EQ(refusal({"slice", "levels", "out.ply"}),
              "how much of it? give --points N, --bytes B or --max-error E");
    EXPECT_EQ(refusal({"slice", "levels", "out.ply", "--points", "1", "--bytes", "1"}),
              "--points, --bytes and --max-error: give one of them");
    for (const char* const box : {"1,2", "1 2 3 4 5 6", "1,2,3,4,5,six", "1,2,3,4,5,6,7"}) {
        EXPECT_NE(
            refusal({"slice", "levels", "out.ply", "--points", "1", "--box", box}).find("--box"),
            std::string::npos);
    }
    EXPECT_NE(refusal({"slice", "levels", "out.ply", "--points", "1", "--box", "1,0,0,0,1,1"})
                  .find("box"),
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

}  // namespace
}  // namespace stipple::cli
