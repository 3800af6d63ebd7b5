// What commands do to files, and to those that stand where results go.

#include "stipple/proto/digest.hpp"
#include "support/stipple_cli.hpp"
#include "support/support.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

namespace stipple {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::content;
using test::Outcome;
using test::StippleCli;

TEST_F(StippleCli, ABrokenFileGivesOneLineThatNamesItAndLeavesNothing) {
    std::ofstream(folder_ / "bad.ply")
        << "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
           "property float y\nproperty float z\nend_header\n0 0 0\n";
    for (const char* command : {"simplify bad.ply out.ply -n 1", "pyramid bad.ply levels",
                                "convert bad.ply out.drc", "inspect bad.ply"}) {
        const Outcome outcome = stipple(command);
        EXPECT_EQ(outcome.exit_code, 1) << command;
        EXPECT_TRUE(outcome.err.starts_with("stipple: bad.ply: ")) << outcome.err;
        EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
        EXPECT_EQ(files(), std::vector<std::string>{"bad.ply"}) << command;
    }
}

TEST_F(StippleCli, AFailureLeavesTheOldOutputAsItWas) {
    std::ofstream(folder_ / "bad.ply") << "ply\n";
    std::ofstream(folder_ / "out.ply") << "precious";
    EXPECT_EQ(stipple("simplify bad.ply out.ply -n 1").exit_code, 1);
    EXPECT_EQ(content(folder_ / "out.ply"), "precious");
}

TEST_F(StippleCli, TheInputIsNeverReplacedByWhatIsMadeOfIt) {
    synthesize("in.ply", 1000);
    fs::create_hard_link(folder_ / "in.ply", folder_ / "linked.ply");
    const std::string before = content(folder_ / "in.ply");
    for (const char* command :
         {"simplify in.ply in.ply -n 5", "upsample in.ply ./in.ply -n 2000",
          "analyze in.ply linked.ply", "analyze in.ply out.ply --feature-lines in.ply",
          "convert in.ply in.ply --ply-encoding ascii",
          "simplify in.ply out.ply -n 5 --json ./in.ply", "inspect in.ply --json in.ply",
          "evaluate in.ply linked.ply --map in.ply", "curve in.ply --json in.ply"}) {
        const Outcome outcome = stipple(command);
        EXPECT_EQ(outcome.exit_code, 1) << command;
        EXPECT_NE(outcome.err.find("it is an input"), std::string::npos) << outcome.err;
        EXPECT_EQ(content(folder_ / "in.ply"), before) << command;
    }
}

TEST_F(StippleCli, NoOutputTakesThePlaceOfAnother) {
    synthesize("in.ply", 1000);
    for (const char* command :
         {"simplify in.ply out.ply -n 5 --json ./out.ply", "curve in.ply --plot a.svg --json a.svg",
          "analyze in.ply out.ply --feature-lines out.ply"}) {
        const Outcome outcome = stipple(command);
        EXPECT_EQ(outcome.exit_code, 1) << command;
        EXPECT_NE(outcome.err.find("it is another output"), std::string::npos) << outcome.err;
        EXPECT_EQ(files(), std::vector<std::string>{"in.ply"}) << command;
    }
}

TEST_F(StippleCli, APyramidLeavesNothingOfTheOneThatStoodThere) {
    synthesize("in.ply", 20'000);
    const auto names = [&] {
        std::vector<std::string> sorted;
        for (const auto& entry : fs::directory_iterator(folder_ / "levels"))
            sorted.push_back(entry.path().filename().string());
        std::ranges::sort(sorted);
        return sorted;
    };
    ASSERT_EQ(stipple("pyramid in.ply levels --levels 100,2000").exit_code, 0);
    std::ofstream(folder_ / "levels/mine.txt") << "of no pyramid";
    const Outcome of_itself = stipple("pyramid levels/level-1.ply levels");
    EXPECT_NE(of_itself.err.find("level-1.ply: it is an input"), std::string::npos)
        << of_itself.err;
    ASSERT_EQ(stipple("pyramid in.ply levels --levels 100 --formats drc").exit_code, 0);
    EXPECT_EQ(names(), (std::vector<std::string>{"level-0.drc", "manifest.json", "mine.txt"}));
    ASSERT_EQ(stipple("pyramid in.ply levels --layout potree").exit_code, 0);
    EXPECT_EQ(names(), (std::vector<std::string>{"hierarchy.bin", "metadata.json", "mine.txt",
                                                 "octree.bin"}));
    std::ofstream(folder_ / "levels/manifest.json") << R"({"name": "a web application"})";
    const Outcome refused = stipple("pyramid in.ply levels");
    EXPECT_EQ(refused.exit_code, 1);
    EXPECT_NE(refused.err.find("choose another folder"), std::string::npos) << refused.err;
    EXPECT_EQ(names().size(), 5U);
}

TEST_F(StippleCli, APlaceThatCannotBeWrittenIsToldBeforeTheWork) {
    std::ofstream(folder_ / "broken.ply") << "ply";  // which the work would tell
    for (const char* command : {"simplify broken.ply out.ply -n 5 --json no/figures.json",
                                "analyze broken.ply out.ply --feature-lines no/lines.ply",
                                "evaluate broken.ply broken.ply --map no/map.png",
                                "curve broken.ply --json no/curve.json",
                                "pyramid broken.ply levels --json no/figures.json"}) {
        const Outcome outcome = stipple(command);
        EXPECT_EQ(outcome.exit_code, 1) << command;
        EXPECT_NE(outcome.err.find("no: cannot write there"), std::string::npos) << outcome.err;
        EXPECT_EQ(files(), std::vector<std::string>{"broken.ply"}) << command;
    }
}

TEST_F(StippleCli, AFolderInTheWayIsToldBeforeTheWork) {
    // Work on it would fail: its header lies about the points.
    std::ofstream(folder_ / "broken.ply")
        << "ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nend_header\n";
    for (const char* const name : {"d.ply", "d.png", "d.svg", "m-2.ply"})
        fs::create_directory(folder_ / name);
    const auto before = files();
    for (const auto& [command, name] : std::vector<std::pair<std::string, std::string>>{
             {"simplify broken.ply d.ply -n 10", "d.ply"},
             {"simplify broken.ply out.ply -n 10 --json d.ply", "d.ply"},
             {"analyze broken.ply d.ply --feature-lines f.ply", "d.ply"},
             {"analyze broken.ply out.ply --feature-lines d.ply", "d.ply"},
             {"convert broken.ply d.ply", "d.ply"},
             {"synthesize d.ply -n 10", "d.ply"},
             {"slice nothing d.ply -n 10", "d.ply"},
             {"curve broken.ply --plot d.svg", "d.svg"},
             {"evaluate broken.ply broken.ply --map m1.ply --map d.png", "d.png"},
             {"evaluate broken.ply broken.ply broken.ply --map m.ply", "m-2.ply"}}) {
        const Outcome outcome = stipple(command);
        EXPECT_EQ(outcome.exit_code, 1) << command;
        EXPECT_EQ(outcome.err,
                  "stipple: " + name + ": it is a folder: give the output another name\n")
            << command;
        EXPECT_EQ(files(), before) << command;
    }
}

TEST_F(StippleCli, FilesOfAPyramidTakeThePlaceOfNoOther) {
    synthesize("in.ply", 2000);
    for (const char* const name : {"manifest.json", "level-0.ply", "tileset.json"}) {
        const Outcome outcome = stipple("pyramid in.ply levels --json levels/" + std::string(name));
        EXPECT_EQ(outcome.exit_code, 1) << name;
        EXPECT_NE(outcome.err.find("it is another output"), std::string::npos) << outcome.err;
        EXPECT_EQ(files(), std::vector<std::string>{"in.ply"}) << name;
    }
    fs::create_directory(folder_ / "levels");
    fs::copy_file(folder_ / "in.ply", folder_ / "levels/level-1.ply");
    const Outcome input = stipple("pyramid levels/level-1.ply levels --levels 10,1000");
    EXPECT_NE(input.err.find("level-1.ply: it is an input"), std::string::npos) << input.err;
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "levels"), {}), 1);
    EXPECT_EQ(stipple("pyramid levels/level-1.ply levels --formats drc").exit_code, 0);
    fs::create_directory(folder_ / "levels/level-0.glb");
    const Outcome in_the_way = stipple("pyramid in.ply levels");
    EXPECT_NE(in_the_way.err.find("level-0.glb: it is a folder"), std::string::npos)
        << in_the_way.err;
    EXPECT_EQ(stipple("pyramid in.ply levels --formats ply --json levels/figures.json").exit_code,
              0);
}

TEST_F(StippleCli, AFailedPyramidLeavesNoFolderThatItMade) {
    std::ofstream(folder_ / "bad.ply") << "ply\n";
    EXPECT_EQ(stipple("pyramid bad.ply a/b/c/").exit_code, 1);
    EXPECT_EQ(files(), std::vector<std::string>{"bad.ply"});
    fs::create_directories(folder_ / "a/b");
    EXPECT_EQ(stipple("pyramid bad.ply a/b/c").exit_code, 1);
    EXPECT_TRUE(fs::is_empty(folder_ / "a/b"));
}

TEST_F(StippleCli, ALinkStaysOneAndAPrivateFileStaysPrivate) {
    synthesize("in.ply", 100);
    fs::create_directory(folder_ / "real");
    for (const char* const command :
         {"simplify in.ply l.ply -n 5", "convert in.ply l.ply", "curve in.ply -n 50 --json l.ply",
          "evaluate in.ply in.ply --map l.ply"}) {
        fs::remove(folder_ / "l.ply");
        fs::create_symlink("real/t.ply", folder_ / "l.ply");
        std::ofstream(folder_ / "real/t.ply") << "old";
        fs::permissions(folder_ / "real/t.ply", fs::perms::owner_read | fs::perms::owner_write);
        const Outcome outcome = stipple(command);
        EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
        EXPECT_TRUE(fs::is_symlink(folder_ / "l.ply")) << command;
        EXPECT_GT(fs::file_size(folder_ / "real/t.ply"), 3U) << command;
        EXPECT_EQ(fs::status(folder_ / "real/t.ply").permissions(),
                  fs::perms::owner_read | fs::perms::owner_write)
            << command;
    }
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "real"), {}), 1);
}

TEST_F(StippleCli, ALimitOnFilesIsAnErrorThatLeavesNothing) {
    synthesize("in.ply", 2000);
    // 8 blocks of 512 or 1024 bytes, as the shell counts.
    for (const char* const command :
         {"simplify in.ply out.ply -n 1500", "convert in.ply out.ply",
          "evaluate in.ply in.ply --map map.ply", "pyramid in.ply levels"}) {
        const Outcome outcome = stipple(command, "ulimit -f 8; ");
        EXPECT_EQ(outcome.exit_code, 1) << command;
        EXPECT_TRUE(outcome.err.find("File too large") != std::string::npos ||
                    outcome.err.find("above the limit of ") != std::string::npos)
            << outcome.err;
        EXPECT_EQ(outcome.err.find("limit of 0 bytes"), std::string::npos) << outcome.err;
        EXPECT_EQ(outcome.err.find(".stipple-"), std::string::npos) << outcome.err;
        EXPECT_EQ(files(), std::vector<std::string>{"in.ply"}) << command;
    }
}

TEST_F(StippleCli, APyramidThatFindsNoRoomLeavesTheOneBeforeAsItWas) {
    synthesize("a.ply", 100);
    ASSERT_EQ(stipple("synthesize b.ply --points 100 --seed 2").exit_code, 0);
    const std::string levels = " levels --formats ply --levels ";
    ASSERT_EQ(stipple("pyramid a.ply" + levels + "10,20,30,40,50,60,70,80,90,100").exit_code, 0);
    const auto hashes = [&] {
        std::map<std::string, std::string> found;
        for (const auto& entry : fs::directory_iterator(folder_ / "levels"))
            found[entry.path().filename()] = proto::sha256_of_file(entry.path());
        return found;
    };
    const std::map<std::string, std::string> before = hashes();
    // Its levels have room, its manifest has not.
    const Outcome outcome =
        stipple("pyramid b.ply" + levels + "10,20,30,40,50,60,70,80,90,100", "ulimit -f 12; ");
    EXPECT_EQ(outcome.exit_code, 1);
    EXPECT_NE(outcome.err.find("levels/manifest.json: cannot be written"), std::string::npos)
        << outcome.err;
    EXPECT_EQ(hashes(), before);
}

TEST_F(StippleCli, ASliceOfAFileThatIsNotOfThePyramidIsRefused) {
    synthesize("a.ply", 100);
    ASSERT_EQ(stipple("pyramid a.ply levels --formats ply --levels 20,100").exit_code, 0);
    ASSERT_EQ(stipple("slice levels out.ply -n 50").exit_code, 0);
    fs::copy_file(folder_ / "levels/level-0.ply", folder_ / "levels/level-1.ply",
                  fs::copy_options::overwrite_existing);
    const Outcome outcome = stipple("slice levels out.ply -n 50");
    EXPECT_EQ(outcome.exit_code, 1);
    EXPECT_NE(outcome.err.find("level-1.ply: not the file that manifest.json tells of"),
              std::string::npos)
        << outcome.err;
}

TEST_F(StippleCli, NamesMayBeAsLongAsTheFileSystemTakes) {
    const std::string name = std::string(251, 'n') + ".ply";  // 255 bytes
    for (const std::string& command :
         {"synthesize " + name + " -n 1000", "convert in.ply " + name,
          "simplify in.ply " + name + " -n 50", "curve in.ply -n 50 --json " + name}) {
        if (!fs::exists(folder_ / "in.ply")) synthesize("in.ply", 1000);
        fs::remove(folder_ / name);
        const Outcome outcome = stipple(command);
        EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
        EXPECT_TRUE(fs::exists(folder_ / name)) << command;
    }
}

TEST_F(StippleCli, ALoopOfLinksIsToldAsWhatItIs) {
    fs::create_symlink("loop.ply", folder_ / "loop.ply");
    const Outcome outcome = stipple("inspect loop.ply");
    EXPECT_EQ(outcome.err,
              "stipple: loop.ply: cannot be read: Too many levels of symbolic links\n");
}

TEST_F(StippleCli, NoOutputTakesThePlaceOfADevice) {
    ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
    synthesize("in.ply", 100);
    const Outcome outcome = stipple("inspect in.ply --json pipe");
    EXPECT_EQ(outcome.err,
              "stipple: pipe: it is not a regular file: give the output another name\n");
    EXPECT_TRUE(fs::is_fifo(folder_ / "pipe"));
}

TEST_F(StippleCli, AnInterruptLeavesNothingBehind) {
    synthesize("in.ply", 1'000'000);
    // Work of seconds, interrupted as Ctrl-C does it.
    const Outcome outcome =
        stipple("pyramid in.ply levels --threads 1", "timeout --preserve-status -s INT 0.3 ");
    EXPECT_EQ(outcome.exit_code, 130);
    EXPECT_EQ(files(), std::vector<std::string>{"in.ply"});
    const Outcome closed =
        stipple("pyramid in.ply levels --threads 1", "timeout --preserve-status -s HUP 0.3 ");
    EXPECT_EQ(closed.exit_code, 129);
    EXPECT_EQ(files(), std::vector<std::string>{"in.ply"});
}

TEST_F(StippleCli, DiesOfTheSignalThatStoppedItSoThatAShellStopsItsScript) {
    synthesize("in.ply", 1'000'000);
    const std::string in = folder_ / "in.ply", levels = folder_ / "levels";
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
        const std::string stipple = test::program("stipple");
        ::execl(stipple.c_str(), "stipple", "pyramid", in.c_str(), levels.c_str(), "--quiet",
                nullptr);
        ::_exit(1);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    ::kill(child, SIGINT);
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status)) << WEXITSTATUS(status);
    EXPECT_EQ(WTERMSIG(status), SIGINT);
    EXPECT_EQ(files(), std::vector<std::string>{"in.ply"});
}

TEST_F(StippleCli, MakesFilesAsTheUsersMaskSays) {
    synthesize("in.ply", 1000);
    ASSERT_EQ(stipple("simplify in.ply out.ply -n 10", "umask 002; ").exit_code, 0);
    ASSERT_EQ(stipple("pyramid in.ply levels", "umask 002; ").exit_code, 0);
    for (const auto& entry : fs::recursive_directory_iterator(folder_.path())) {
        if (!entry.is_regular_file() || entry.path().filename() == "in.ply") continue;
        EXPECT_EQ(entry.status().permissions(), fs::perms(0664)) << entry.path();
    }
}

TEST_F(StippleCli, RemovesWhatAKilledRunLeftAndNothingElse) {
    synthesize("in.ply", 1000);
    const auto make = [&](const std::string& name, bool old) {
        fs::create_directory(folder_ / name);
        std::ofstream(folder_ / name / "level-0.ply") << "half";
        if (old)
            fs::last_write_time(folder_ / name,
                                fs::file_time_type::clock::now() - std::chrono::hours(2));
    };
    make(".stipple-killed", true);
    make(".stipple-is-mine", true);
    make(".stipple-fresh1", false);
    make(".stipple-in-use", true);
    const int in_use = ::open((folder_ / ".stipple-in-use").c_str(), O_RDONLY | O_DIRECTORY);
    ASSERT_EQ(::flock(in_use, LOCK_EX | LOCK_NB), 0);
    EXPECT_EQ(stipple("simplify in.ply out.ply -n 10").exit_code, 0);
    EXPECT_EQ(files(), (std::vector<std::string>{".stipple-fresh1", ".stipple-in-use",
                                                 ".stipple-is-mine", "in.ply", "out.ply"}));
    ::close(in_use);
}

}  // namespace
}  // namespace stipple
