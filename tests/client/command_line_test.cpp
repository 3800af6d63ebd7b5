// What holds of every command, and words that are none.
#include "parsed_command.hpp"

#include <gtest/gtest.h>

namespace stipple::cli {
namespace {

TEST(CommandLine, DashIsStandardOutputForTheFigures) {
    EXPECT_EQ(parsed<InspectCommand>({"inspect", "in.ply", "--json", "-"}).common.json, "-");
}

TEST(CommandLine, RepeatsUnexpectedWordsInTheirOrder) {
    EXPECT_EQ(refusal({"inspect", "in.ply", "b", "-c", "d"}),
              "these were not expected: b -c d (see --help)");
    EXPECT_EQ(refusal({"inspect", "in.ply", "b"}), "not expected: b (see --help)");
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
    EXPECT_EQ(refusal({"--points", "5", "simplify", "i.ply", "o.ply"}),
              "--points: give it after the command, as in: stipple COMMAND FILE --points");
    EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "--verbose", "-n", "5"}),
              "--verbose: no such option (see --help)");
    EXPECT_EQ(refusal({"curve", "i.ply", "--voxel-sise", "5"}),  // it has no --voxel-size either
              "--voxel-sise: no such option (see --help)");
    EXPECT_EQ(refusal({"--versoin"}), "--versoin: no such option: did you mean --version?");
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

}  // namespace
}  // namespace stipple::cli
