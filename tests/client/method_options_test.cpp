// The options that only some methods have, and those that say how many points are kept.
#include "parsed_command.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <map>

namespace stipple::cli {
namespace {

TEST(CommandLine, TheDefaultMethodIsThatOfCore) {
    const auto command = parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-n", "5"});
    EXPECT_EQ(command.job.options.method, Method::Multiphase);
    EXPECT_EQ(command.job.added.splats, SplatAttributes::Radius);
    EXPECT_FALSE(command.job.added.source_index);
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

TEST(CommandLine, ReductionsAreByName) {
    const auto command =
        parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-n", "5", "--reduce",
                                 "intensity=max", "--reduce", "label=mode"});
    EXPECT_EQ(command.job.options.reductions.at("intensity"), Reduction::Max);
    EXPECT_EQ(command.job.options.reductions.at("label"), Reduction::Mode);
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

TEST(CommandLine, WhatTheLibraryRefusesIsNamedAsTheOption) {
    const auto refused = [](std::vector<std::string> more) {
        std::vector<std::string> words = {"simplify", "i.ply", "o.ply"};
        words.insert(words.end(), more.begin(), more.end());
        return refusal(words);
    };
    EXPECT_TRUE(
        refused({"-n", "5", "--attribute-weight", "heat=-1"}).starts_with("--attribute-weight"));
    EXPECT_TRUE(refused({"-n", "5", "-m", "particles", "--region", "sphere:0,0,0,0:4"})
                    .starts_with("--region[0]: radius 0"));
    EXPECT_TRUE(refused({"--max-error", "0%"}).starts_with("--max-error 0%: expected"));
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

}  // namespace
}  // namespace stipple::cli
