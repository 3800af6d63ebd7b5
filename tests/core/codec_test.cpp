#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "support/expect_error.hpp"
#include "support/ply_text.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <algorithm>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <sstream>

namespace stipple {
namespace {

namespace fs = std::filesystem;

std::vector<std::byte> contents(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    const std::string text((std::istreambuf_iterator<char>(in)), {});
    const auto* const data = reinterpret_cast<const std::byte*>(text.data());
    return {data, data + text.size()};
}

std::vector<fs::path> files_in(const fs::path& folder) {
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(folder)) {
        if (entry.path().extension() == ".ply" || entry.path().extension() == ".drc")
            files.push_back(entry.path());
    }
    std::ranges::sort(files);
    return files;
}

/// How a decoding ended: the points, or an error with its message.
struct Outcome {
    enum Kind { Cloud, Refused, Broken } kind = Broken;
    ErrorCode code = ErrorCode::Internal;
    std::string text;
};

Outcome decode_here(std::span<const std::byte> bytes) {
    RunContext context;
    context.threads = 1;
    try {
        const PointCloud cloud = decode_cloud(bytes, {}, context);
        validate(cloud);
        return {Outcome::Cloud, {}, std::to_string(cloud.size())};
    } catch (const Error& error) {
        return {Outcome::Refused, error.code(), error.what()};
    } catch (const std::exception& error) {
        return {Outcome::Broken, {}, error.what()};
    }
}

/// Decodes in a process of its own with at most a gigabyte, so that a hostile file takes neither
/// this one nor the machine.
std::vector<Outcome> decode_all_apart(const std::vector<std::vector<std::byte>>& inputs) {
    std::array<int, 2> ends{};
    if (::pipe(ends.data()) != 0) throw std::runtime_error("pipe");
    const pid_t child = ::fork();
    if (child == 0) {
        const rlimit memory{rlim_t{1} << 30, rlim_t{1} << 30};
        if (!test::kSanitized) ::setrlimit(RLIMIT_AS, &memory);
        for (const auto& input : inputs) {
            const Outcome outcome = decode_here(input);
            std::string line = std::to_string(outcome.kind) + " " +
                               std::to_string(static_cast<int>(outcome.code)) + " " + outcome.text +
                               "\n";
            if (::write(ends[1], line.data(), line.size()) != static_cast<ssize_t>(line.size()))
                ::_exit(3);
        }
        ::_exit(0);
    }
    ::close(ends[1]);
    std::string all;
    std::array<char, 4096> chunk;
    for (ssize_t got = 0; (got = ::read(ends[0], chunk.data(), chunk.size())) > 0;) {
        all.append(chunk.data(), static_cast<std::size_t>(got));
    }
    ::close(ends[0]);
    int status = 0;
    ::waitpid(child, &status, 0);

    std::vector<Outcome> outcomes(inputs.size());
    std::istringstream lines(all);
    std::size_t i = 0;
    for (std::string line; i < outcomes.size() && std::getline(lines, line); ++i) {
        std::istringstream words(line);
        int kind = 0, code = 0;
        words >> kind >> code;
        outcomes[i] = {static_cast<Outcome::Kind>(kind), static_cast<ErrorCode>(code),
                       line.substr(4)};
    }
    if (i < outcomes.size())
        outcomes[i].text = "the process ended with status " + std::to_string(status);
    return outcomes;
}

/// A sentence for the one who sent the file: it names the place or the value, and has no line
/// breaks.
void expect_clear(const Outcome& outcome, const std::string& what) {
    EXPECT_EQ(outcome.kind, Outcome::Refused) << what << ": " << outcome.text;
    EXPECT_NE(outcome.code, ErrorCode::Internal) << what;
    EXPECT_GE(outcome.text.size(), 20U) << what << ": " << outcome.text;
}

std::vector<std::vector<std::byte>> truncations(const std::vector<std::byte>& whole,
                                                std::size_t step = 1) {
    std::vector<std::vector<std::byte>> cuts;
    for (std::size_t size = 0; size < whole.size(); size += step) {
        cuts.emplace_back(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    }
    return cuts;
}

TEST(BadFiles, AreEachRefusedWithOneClearError) {
    const std::vector<fs::path> files = files_in(test::data_file("bad"));
    ASSERT_GE(files.size(), 47U);
    for (const fs::path& file : files) {
        if (test::kSanitized && file.filename().string().starts_with("bomb")) continue;
        const Outcome outcome = decode_all_apart({contents(file)}).at(0);
        expect_clear(outcome, file.filename());
        std::cout << file.filename().string() << ": " << outcome.text << '\n';
    }
}

TEST(BadFiles, HaveTheCodeOfTheirFault) {
    const auto code_of = [](const char* name) {
        return decode_here(contents(test::data_file("bad") / name)).code;
    };
    EXPECT_EQ(code_of("empty.ply"), ErrorCode::UnsupportedFormat);
    EXPECT_EQ(code_of("gzip_inside.ply"), ErrorCode::UnsupportedFormat);
    EXPECT_EQ(code_of("ply_unknown_format.ply"), ErrorCode::UnsupportedFormat);
    EXPECT_EQ(code_of("ply_unknown_version.ply"), ErrorCode::UnsupportedFormat);
    EXPECT_EQ(code_of("draco_future_version.drc"), ErrorCode::UnsupportedFormat);
    EXPECT_EQ(code_of("ply_binary_over_limit.ply"), ErrorCode::TooLarge);
    EXPECT_EQ(code_of("draco_points_over_limit.drc"), ErrorCode::TooLarge);
    EXPECT_EQ(code_of("draco_kd_points_over_limit.drc"), ErrorCode::TooLarge);
    EXPECT_EQ(code_of("ply_binary_promises_too_much.ply"), ErrorCode::MalformedInput);
    EXPECT_EQ(code_of("ply_short_line.ply"), ErrorCode::MalformedInput);
    EXPECT_EQ(code_of("draco_metadata_truncated.drc"), ErrorCode::MalformedInput);
}

TEST(DracoDecoder, GivesACloudOrAnErrorForEveryTruncation) {
    const PointCloud cloud = test::with_attributes(test::sphere(20));
    for (const DracoCoding coding : {DracoCoding::Sequential, DracoCoding::KdTree}) {
        const auto whole = encode_draco(cloud, {.coding = coding, .precision = {}});
        for (const Outcome& outcome : decode_all_apart(truncations(whole))) {
            if (outcome.kind == Outcome::Cloud) {
                EXPECT_EQ(outcome.text, "20");
            } else {
                EXPECT_EQ(outcome.kind, Outcome::Refused) << outcome.text;
            }
        }
    }
}

TEST(RealFiles, OfThePlyCorpusGiveACloudOrOneClearError) {
    const auto folder = test::shared_folder("ply-corpus");
    if (!folder) GTEST_SKIP() << "the shared test data is not here";
    const std::set<std::string> bad = {"assimp__crash-30d6d0f7c529b3b66b4131700b7a4580cd7082df.ply",
                                       "assimp__empty.ply",
                                       "assimp__issue623.ply",
                                       "open3d__truncated_test_sample_wrong_format.ply",
                                       "pdal__no_vertex.ply",
                                       "ply-rs__single_elements_err_ascii.ply",
                                       "pyntcloud__git_lfs_pointer.ply"};
    for (const fs::path& file : files_in(*folder)) {
        const Outcome outcome = decode_here(contents(file));
        if (bad.contains(file.filename())) {
            expect_clear(outcome, file.filename());
        } else {
            EXPECT_EQ(outcome.kind, Outcome::Cloud) << file.filename() << ": " << outcome.text;
        }
    }
}

TEST(RealFiles, CutShortGiveACloudOrAnError) {
    std::size_t files = 0;
    for (const char* name : {"ply-corpus", "draco"}) {
        const auto folder = test::shared_folder(name);
        if (!folder) GTEST_SKIP() << "the shared test data is not here";
        for (const fs::path& file : files_in(*folder)) {
            constexpr std::uintmax_t kSmall = 3000;
            if (fs::file_size(file) > kSmall) continue;
            ++files;
            const auto outcomes =
                decode_all_apart(truncations(contents(file), test::kSanitized ? 7 : 1));
            for (std::size_t i = 0; i < outcomes.size(); ++i) {
                ASSERT_NE(outcomes[i].kind, Outcome::Broken)
                    << file.filename() << " cut " << i << ": " << outcomes[i].text;
            }
        }
    }
    EXPECT_GE(files, 30U);
}

TEST(RealFiles, OfDracoGiveTheCountsTheirMakersSay) {
    const auto folder = test::shared_folder("draco");
    if (!folder) GTEST_SKIP() << "the shared test data is not here";
    const std::map<std::string, std::size_t> points = {{"bunny.drc", 34834},
                                                       {"bunny_gltf.drc", 34834},
                                                       {"car.drc", 1856},
                                                       {"cube_att.drc", 24},
                                                       {"octagon_preserved.drc", 16},
                                                       {"pc_color.drc", 7733},
                                                       {"pc_kd_color.drc", 7733},
                                                       {"pdal_1.2-with-color.drc", 1065},
                                                       {"point_cloud_no_qp.drc", 21},
                                                       {"webtix_monkey.drc", 35326},
                                                       {"cesium_PointCloudDracoPartial.drc", 1000}};
    std::size_t seen = 0;
    for (const fs::path& file : files_in(*folder)) {
        const Outcome outcome = decode_here(contents(file));
        EXPECT_EQ(outcome.kind, Outcome::Cloud) << file.filename() << ": " << outcome.text;
        if (const auto known = points.find(file.filename()); known != points.end()) {
            ++seen;
            EXPECT_EQ(outcome.text, std::to_string(known->second)) << file.filename();
        }
    }
    EXPECT_EQ(seen, points.size());
}

TEST(RealFiles, OfAerialLidarComeBackWithinFloatPrecisionOfTheirExtent) {
    const auto file = test::shared_file("lidar/autzen_stadium_tile.ply");
    if (!file) GTEST_SKIP() << "the shared test data is not here";
    const PointCloud cloud = read_cloud(*file);
    ASSERT_EQ(cloud.size(), 1'268'079U);
    EXPECT_TRUE(cloud.double_precision);
    const auto bytes = contents(*file);
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    const std::size_t body = text.find("end_header\n") + 11;
    const std::size_t stride = (bytes.size() - body) / cloud.size();
    const double bound = bounds(cloud).diagonal() * 0x1p-23;
    double worst = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        Vec3d exact;
        std::memcpy(exact.data(), bytes.data() + body + i * stride, sizeof(exact));
        worst = std::max(
            worst,
            (cloud.origin + cloud.positions[i].cast<double>() - exact).cwiseAbs().maxCoeff());
    }
    EXPECT_LE(worst, bound);
    const auto once = encode_ply(cloud);
    EXPECT_EQ(encode_ply(decode_cloud(once)), once);
}

TEST(Codec, KnowsFormatsByNameAndByFirstBytes) {
    const auto detect = [](std::string_view text) {
        return detect_format(std::as_bytes(std::span(text.data(), text.size())));
    };
    EXPECT_EQ(detect("ply\n"), CloudFormat::Ply);
    EXPECT_EQ(detect("ply \r\n"), CloudFormat::Ply);
    EXPECT_EQ(detect("DRACO\x02"), CloudFormat::Draco);
    EXPECT_EQ(detect("STPC\x01"), CloudFormat::Progressive);
    EXPECT_EQ(detect("plywood"), std::nullopt);
    EXPECT_EQ(detect("DRAC"), std::nullopt);
    EXPECT_EQ(detect(""), std::nullopt);
    for (const CloudFormat format : {CloudFormat::Ply, CloudFormat::Draco}) {
        EXPECT_EQ(cloud_format_from_name(to_string(format)), format);
        EXPECT_TRUE(media_type(format).starts_with("model/"));
    }
    EXPECT_EQ(cloud_format_from_name("draco"), CloudFormat::Draco);
    test::expect_error(ErrorCode::UnsupportedFormat, "format 'obj': expected ply, drc",
                       [&] { cloud_format_from_name("obj"); });
}

TEST(CheckHead, TellsTheFormatsThatAreRead) {
    const auto format = [](std::string_view head) {
        return check_head(test::bytes_of(head), 1000);
    };
    EXPECT_EQ(format("DRACO\x02\x02"), CloudFormat::Draco);
    EXPECT_EQ(format("STPC\x01"), CloudFormat::Progressive);
    EXPECT_EQ(format("ply\nformat ascii 1.0\n"), CloudFormat::Ply) << "its header goes on";
}

TEST(CheckHead, RefusesEveryOtherFormatSayingWhatItProbablyIs) {
    const auto refused = [](std::string_view head, std::string_view reason) {
        test::expect_error(ErrorCode::UnsupportedFormat, reason,
                           [head] { check_head(test::bytes_of(head), 1000); });
    };
    refused("", "the file is empty: expected PLY");
    refused("hello", "neither PLY, Draco nor a progressive stream: the file starts with 'hello'");
    refused("plyformat ascii 1.0", "--data-binary");
    refused("\x1F\x8B\x08", "unpack it first");
    refused("PK\x03\x04", "unpack it first");
    refused("\x28\xB5\x2F\xFD", "unpack it first");
    refused("LASF", "convert it to PLY first");
    refused("version https://git-lfs", "git lfs pull");
    refused("glTF\x02", "nor a progressive stream");
}

TEST(CheckHead, RefusesAPlyFileByItsHeaderAndItsSize) {
    for (const PlyEncoding encoding :
         {PlyEncoding::BinaryLittleEndian, PlyEncoding::BinaryBigEndian, PlyEncoding::Ascii}) {
        const auto file = encode_ply(test::sphere(1000), {.encoding = encoding, .comments = {}});
        const std::span head = std::span(file).first(200);
        const std::uint64_t least = encoding == PlyEncoding::Ascii ? 6000 : 12000;
        EXPECT_EQ(check_head(head, file.size()), CloudFormat::Ply);
        EXPECT_EQ(check_head(file, file.size()), CloudFormat::Ply);
        const auto refused = [&](ErrorCode code, std::string_view reason, auto... arguments) {
            test::expect_error(code, reason, [&] { check_head(head, arguments...); });
        };
        refused(ErrorCode::MalformedInput, "declares 1000 of element 'vertex'", least - 1);
        refused(ErrorCode::MalformedInput, "the file is cut short", std::uint64_t{200});
        refused(ErrorCode::TooLarge, "1000 vertices: expected at most 999", file.size(),
                DecodeLimits{.max_points = 999});
    }
}

TEST(CheckHead, LeavesAHeaderThatGoesOnToTheDecoder) {
    const std::string_view head =
        "ply\nformat ascii 1.0\ncomment end_header\nelement vertex 9\nproperty int q\n";
    EXPECT_EQ(check_head(test::bytes_of(head), head.size() + 1), CloudFormat::Ply);
    test::expect_error(ErrorCode::MalformedInput, "without end_header",
                       [&] { check_head(test::bytes_of(head), head.size()); });
    const std::string whole = std::string(head) + "end_header\n";
    test::expect_error(ErrorCode::MalformedInput, "no property 'x'",
                       [&] { check_head(test::bytes_of(whole), 1000); });
}

TEST(Codec, WritesWholeFilesByTheirExtensionAndLeavesNothingBeside) {
    const test::TemporaryFolder folder;
    const PointCloud cloud = test::with_attributes(test::sphere(100));
    write_cloud(cloud, folder / "a.PLY");
    write_cloud(cloud, folder / "a.drc");
    write_cloud(test::sphere(7), folder / "a.drc");
    EXPECT_EQ(read_cloud(folder / "a.PLY").positions, cloud.positions);
    EXPECT_EQ(read_cloud(folder / "a.drc").size(), 7U);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 2);
}

TEST(Codec, LeavesTheOldFileWhenItCannotWriteTheNew) {
    const test::TemporaryFolder folder;
    write_cloud(test::sphere(5), folder / "a.ply");
    PointCloud bad = test::sphere(3);
    bad.attributes.push_back({"x", std::vector<float>(3), 1, Reduction::Mean});
    test::expect_refused("would have two properties of this name",
                         [&] { write_cloud(bad, folder / "a.ply"); });
    EXPECT_EQ(read_cloud(folder / "a.ply").size(), 5U);
    fs::create_directory(folder / "taken.ply");
    test::expect_refused("it is a folder",
                         [&] { write_cloud(test::sphere(3), folder / "taken.ply"); });
    EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 2);
}

TEST(Codec, SaysWhyAFileCannotBeReadOrWritten) {
    const test::TemporaryFolder folder;
    const auto code_of = [](const auto& call) {
        try {
            call();
        } catch (const Error& error) {
            return error.code();
        }
        return ErrorCode::Internal;
    };
    EXPECT_EQ(code_of([&] { read_cloud(folder / "none.ply"); }), ErrorCode::NotFound);
    EXPECT_EQ(code_of([&] { read_cloud(folder.path()); }), ErrorCode::InvalidArgument);
    EXPECT_EQ(code_of([&] { write_cloud(test::sphere(1), folder / "a.obj"); }),
              ErrorCode::UnsupportedFormat);
    EXPECT_EQ(code_of([&] { write_cloud(test::sphere(1), folder / "no/a.ply"); }),
              ErrorCode::NotFound);
}

TEST(Codec, TakesThePlaceOfNoDevice) {
    const test::TemporaryFolder folder;
    const fs::path fifo = folder / "fifo.ply";
    ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
    test::expect_refused("it is not a regular file", [&] { write_cloud(test::sphere(5), fifo); });
    EXPECT_TRUE(fs::is_fifo(fifo));
    const fs::path longest = folder / (std::string(250, 'x') + ".ply");
    write_cloud(test::sphere(5), longest);
    EXPECT_EQ(read_cloud(longest).size(), 5U);
}

TEST(Codec, ReadsFromAPipe) {
    const test::TemporaryFolder folder;
    const fs::path fifo = folder / "fifo";
    ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
    const PointCloud cloud = test::sphere(100'000);
    const auto bytes = encode_ply(cloud);
    const pid_t child = ::fork();
    if (child == 0) {
        std::ofstream(fifo, std::ios::binary)
            .write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
        ::_exit(0);
    }
    EXPECT_EQ(read_cloud(fifo).positions, cloud.positions);
    ::waitpid(child, nullptr, 0);
}

}  // namespace
}  // namespace stipple
