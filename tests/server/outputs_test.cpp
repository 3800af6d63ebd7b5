#include "service/outputs.hpp"

#include "http/conditional.hpp"
#include "http/tar.hpp"
#include "store_fixtures.hpp"

#include <brotli/decode.h>
#include <zlib.h>
#include <array>
#include <barrier>
#include <fstream>
#include <thread>

namespace stipple::server {
namespace {

using namespace stipple::test;
using namespace std::chrono_literals;

constexpr std::array kBrotliFirst = {Coding::Brotli, Coding::Gzip, Coding::Identity};
constexpr std::array kGzipFirst = {Coding::Gzip, Coding::Identity};

/// Text that packs well.
std::string verse(int lines) {
    std::string text;
    for (int i = 0; i < lines; ++i) text += "and line " + std::to_string(i) + " of many lines\n";
    return text;
}

std::string noise(std::size_t bytes) {
    std::string text(bytes, '\0');
    std::uint64_t state = 1;
    for (char& c : text) {
        state = state * 6364136223846793005ULL + 1442695040888963407ULL;
        c = static_cast<char>(state >> 56U);
    }
    return text;
}

std::string text_of(std::span<const std::byte> bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::string unpacked(std::span<const std::byte> packed, Coding coding) {
    std::string text(1 << 20, '\0');
    if (coding == Coding::Brotli) {
        std::size_t size = text.size();
        EXPECT_EQ(::BrotliDecoderDecompress(packed.size(),
                                            reinterpret_cast<const std::uint8_t*>(packed.data()),
                                            &size, reinterpret_cast<std::uint8_t*>(text.data())),
                  BROTLI_DECODER_RESULT_SUCCESS);
        text.resize(size);
        return text;
    }
    z_stream stream{};
    EXPECT_EQ(::inflateInit2(&stream, MAX_WBITS + 16), Z_OK);
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<std::byte*>(packed.data()));
    stream.avail_in = static_cast<uInt>(packed.size());
    stream.next_out = reinterpret_cast<Bytef*>(text.data());
    stream.avail_out = static_cast<uInt>(text.size());
    EXPECT_EQ(::inflate(&stream, Z_FINISH), Z_STREAM_END);
    text.resize(stream.total_out);
    ::inflateEnd(&stream);
    return text;
}

TEST(Packing, UnpacksToTheSameBytes) {
    const std::string text = verse(10'000);
    for (const Packing& packing : {kGzip, kQuickBrotli, kBestBrotli}) {
        const auto packed = pack(bytes_of(text), packing);
        ASSERT_TRUE(packed) << packing.name;
        EXPECT_LT(packed->size(), text.size() / 4) << packing.name;
        EXPECT_EQ(unpacked(*packed, packing.coding), text) << packing.name;
        EXPECT_EQ(pack(bytes_of(text), packing), packed) << packing.name;
    }
}

TEST(Packing, GivesNothingWhereItWouldNotPay) {
    for (const Packing& packing : {kGzip, kQuickBrotli, kBestBrotli}) {
        EXPECT_FALSE(pack(bytes_of(noise(100'000)), packing)) << packing.name;
        EXPECT_FALSE(pack({}, packing)) << packing.name;
        EXPECT_FALSE(pack(bytes_of("x"), packing)) << packing.name;
    }
}

TEST(Packing, EndsWhenItIsStopped) {
    std::stop_source stop;
    stop.request_stop();
    EXPECT_FALSE(pack(bytes_of(verse(1000)), kBestBrotli, stop.get_token()));
}

TEST(OutputCache, ForgetsTheFilesThatWereNotAskedForLongest) {
    OutputCache cache(10'000);
    const auto file = [](std::size_t bytes) {
        return OutputCache::File{std::make_shared<const std::vector<std::byte>>(bytes), "tag"};
    };
    cache.put("a", file(4000));
    cache.put("b", file(4000));
    EXPECT_TRUE(cache.find("a"));
    cache.put("c", file(4000));
    EXPECT_TRUE(cache.find("a"));
    EXPECT_FALSE(cache.find("b"));
    EXPECT_TRUE(cache.find("c"));
    cache.remove("c");
    EXPECT_FALSE(cache.find("c"));
    cache.put("d", file(20'000));
    EXPECT_FALSE(cache.find("d"));
    cache.put("a", file(4000));
    EXPECT_TRUE(cache.find("a"));
}

class OutputsTest : public testing::Test {
protected:
    /// A finished pyramid with one tile of these bytes.
    std::string pyramid_with(std::string_view bytes, CloudFormat format = CloudFormat::Glb) {
        const proto::JobDocument job =
            jobs_->submit("ada", pyramid_request(put_cloud(*jobs_, "ada", "cloud")), {}, {})
                .document;
        const Lease lease = jobs_->claim({}, 60s).value();
        file_ = put_blob(*blobs_, bytes);
        name_ = file_ + "." + std::string(to_string(format));
        proto::OutputCloud level = level_with(0, file_);
        level.files[0].format = format;
        level.files[0].bytes = bytes.size();
        if (format == CloudFormat::Glb) level.files[0].tile.emplace().points = 10;
        jobs_->report_source(lease, statistics_of(10));
        jobs_->publish_level(lease, level);
        jobs_->succeed(lease, {});
        return job.id;
    }

    /// The file once it comes with this tag; as it last came when that takes too long.
    StoredFile file_tagged(const std::string& job, const std::string& tag) {
        for (int i = 0; i < 1000; ++i) {
            const StoredFile file = outputs_.file("ada", job, name_, kBrotliFirst);
            if (file.tag == tag) return file;
            std::this_thread::sleep_for(10ms);
        }
        return outputs_.file("ada", job, name_, kBrotliFirst);
    }

    static std::string plain(const StoredFile& file) {
        const auto& bytes = *std::get<Bytes>(file.content);
        return file.coding == Coding::Identity ? text_of(bytes) : unpacked(bytes, file.coding);
    }

    TemporaryFolder folder_;
    std::unique_ptr<BlobStore> blobs_ = open_file_blob_store(folder_ / "blobs");
    std::unique_ptr<JobStore> jobs_ = open_sqlite_job_store(folder_ / "jobs.sqlite");
    Outputs outputs_{*jobs_, *blobs_, Links()};
    std::string file_, name_;  ///< its hash, and that with the extension
};

TEST_F(OutputsTest, PacksATileInTheBackgroundBestAtLast) {
    const std::string text = verse(2000);
    const std::string job = pyramid_with(text);
    const StoredFile first = outputs_.file("ada", job, name_, kBrotliFirst);
    EXPECT_EQ(plain(first), text);
    EXPECT_TRUE(first.negotiated);

    const StoredFile best = file_tagged(job, file_ + "-br11");
    EXPECT_EQ(best.tag, file_ + "-br11");
    EXPECT_EQ(best.coding, Coding::Brotli);
    EXPECT_EQ(plain(best), text);
    EXPECT_FALSE(blobs_->copy(file_, kQuickBrotli.name));

    const StoredFile gzipped = outputs_.file("ada", job, name_, kGzipFirst);
    EXPECT_EQ(gzipped.tag, file_ + "-gz6");
    EXPECT_EQ(plain(gzipped), text);
    const StoredFile identity = outputs_.file("ada", job, name_, {});
    EXPECT_EQ(identity.tag, file_);
    EXPECT_EQ(plain(identity), text);
}

TEST_F(OutputsTest, PacksWhatWasAnnouncedBeforeAnyoneAsks) {
    const std::string job = pyramid_with(verse(2000));
    outputs_.announce(outputs_.results("ada", job)->levels.at(0));
    for (int i = 0; i < 1000 && !blobs_->copy(file_, kBestBrotli.name); ++i)
        std::this_thread::sleep_for(10ms);
    EXPECT_TRUE(blobs_->copy(file_, kBestBrotli.name));
}

TEST_F(OutputsTest, SendsPlainWhatDoesNotPackAndNeverTriesAgain) {
    const std::string job = pyramid_with(noise(20'000));
    EXPECT_EQ(outputs_.file("ada", job, name_, kBrotliFirst).tag, file_);
    for (int i = 0; i < 1000 && !blobs_->copy(file_, kBestBrotli.name); ++i)
        std::this_thread::sleep_for(10ms);
    ASSERT_TRUE(blobs_->copy(file_, kBestBrotli.name));
    EXPECT_TRUE(blobs_->copy(file_, kBestBrotli.name)->empty());
    EXPECT_EQ(outputs_.file("ada", job, name_, kBrotliFirst).tag, file_);
}

TEST_F(OutputsTest, NeverPacksDraco) {
    const std::string job = pyramid_with(verse(1000), CloudFormat::Draco);
    const StoredFile file = outputs_.file("ada", job, name_, kBrotliFirst);
    EXPECT_FALSE(file.negotiated);
    EXPECT_EQ(file.coding, Coding::Identity);
}

TEST_F(OutputsTest, ServesNothingOfAJobThatWasRemoved) {
    const std::string job = pyramid_with("tile");
    EXPECT_EQ(plain(outputs_.file("ada", job, name_, {})), "tile");
    expect_error(ErrorCode::NotFound, "no such job", [&] { outputs_.file("bob", job, name_, {}); });
    jobs_->dismiss("ada", job);
    expect_error(ErrorCode::NotFound, "no such job", [&] { outputs_.file("ada", job, name_, {}); });
    EXPECT_EQ(outputs_.results("ada", job), nullptr);
}

TEST_F(OutputsTest, AsksNoDatabaseForAFinishedPyramid) {
    const std::string job = pyramid_with("tile");
    const auto results = outputs_.results("ada", job);
    EXPECT_EQ(outputs_.results("ada", job), results);  // the same object
    put_cloud(*jobs_, "ada", "another");               // something else was written
    EXPECT_EQ(outputs_.results("ada", job), results);
}

TEST_F(OutputsTest, PacksDocumentsUnderTagsOfTheirOwn) {
    const std::string job = pyramid_with("tile");
    const StoredFile plain_file = outputs_.document("ada", job, "manifest.json", {});
    const StoredFile packed = outputs_.document("ada", job, "manifest.json", kBrotliFirst);
    EXPECT_EQ(packed.coding, Coding::Brotli);
    EXPECT_EQ(packed.tag, plain_file.tag + "-br5");
    EXPECT_EQ(plain(packed), plain(plain_file));
    EXPECT_EQ(plain(outputs_.document("ada", job, "tileset.json", kGzipFirst)),
              plain(outputs_.document("ada", job, "tileset.json", {})));
    expect_error(ErrorCode::NotFound, "no such file of this pyramid",
                 [&] { outputs_.document("ada", job, "tileset-1.json", {}); });
}

TEST_F(OutputsTest, HasDocumentsUnderTheirNamesAlone) {
    const std::string job = pyramid_with("tile");
    for (const auto& accepted : {std::span<const Coding>(), std::span<const Coding>(kBrotliFirst)})
        for (const char* name : {"manifest.json", "tileset.json"})
            outputs_.document("ada", job, name, accepted);
    for (const std::string name :
         {"tileset.json.br", "tileset.json.br.br", "tileset.json?error=avg", "tileset-.json",
          "tileset-0.json.br", "tileset-a.json", "manifest.json#drc", "../x/tileset.json", ""})
        expect_error(ErrorCode::NotFound, "no such file of this pyramid",
                     [&] { outputs_.document("ada", job, name, kBrotliFirst); });
}

TEST_F(OutputsTest, OfASharedStoreAreAsNewAsTheJobs) {
    const auto shared = open_sqlite_job_store(folder_ / "jobs.sqlite", Sharing::WithOtherProcesses);
    Outputs outputs(*shared, *blobs_, Links());
    const std::string job =
        jobs_->submit("ada", pyramid_request(put_cloud(*jobs_, "ada", "cloud")), {}, {})
            .document.id;
    const Lease lease = jobs_->claim({}, 60s).value();
    EXPECT_FALSE(outputs.results("ada", job)->complete);
    jobs_->publish_level(lease, level_with(0, put_blob(*blobs_, "tile")));
    jobs_->succeed(lease, {});
    EXPECT_TRUE(outputs.results("ada", job)->complete);
}

TEST_F(OutputsTest, ReadAJobOnceForAllWhoAskAtATime) {
    const std::string job =
        jobs_->submit("ada", pyramid_request(put_cloud(*jobs_, "ada", "cloud")), {}, {})
            .document.id;
    const Lease lease = jobs_->claim({}, 60s).value();
    proto::OutputCloud level = level_with(0, put_blob(*blobs_, "tile"));
    level.files.resize(5'000, level.files[0]);
    jobs_->publish_level(lease, level);
    jobs_->succeed(lease, {});
    std::array<std::shared_ptr<const proto::Results>, 8> results;
    {
        std::barrier start(results.size());
        std::vector<std::jthread> asking;
        for (auto& mine : results)
            asking.emplace_back([&] {
                start.arrive_and_wait();
                mine = outputs_.results("ada", job);
            });
    }
    for (const auto& each : results) EXPECT_EQ(each, results[0]);
    EXPECT_EQ(results[0]->levels.at(0).files.size(), 5'000U);
}

/// A pyramid of a tile and one below it.
class TilesetTest : public OutputsTest {
protected:
    void SetUp() override {
        const proto::JobDocument job =
            jobs_->submit("ada", pyramid_request(put_cloud(*jobs_, "ada", "cloud")), {}, {})
                .document;
        id_ = job.id;
        lease_ = jobs_->claim({}, 60s).value();
        jobs_->report_source(lease_, statistics_of(20));
        proto::OutputCloud level = level_with(0, put_blob(*blobs_, "tile"));
        level.files[0].format = CloudFormat::Glb;
        level.files[0].tile.emplace().points = 10;
        level.files.push_back(level.files[0]);
        level.files[1].tile->parent = 0;
        jobs_->publish_level(lease_, level);
    }
    StoredFile document(const std::string& name, std::size_t max_tiles,
                        std::span<const Coding> accepted = {}) {
        return outputs_.document("ada", id_, name, accepted,
                                 {.inlined = {}, .tileset = {.max_tiles = max_tiles}});
    }

    std::string id_;
    Lease lease_;
};

TEST_F(TilesetTest, IsWrittenOnceForAllOfItsFiles) {
    jobs_->succeed(lease_, {});
    document("tileset.json", 1);
    // Written anew, with more tiles in a file, this one would not be there.
    EXPECT_NE(plain(document("tileset-1.json", 9)).find("geometricError"), std::string::npos);
}

TEST_F(TilesetTest, IsWrittenInATurnAndSentFromMemoryWithout) {
    jobs_->succeed(lease_, {});
    int turns = 0;
    bool is_held = false;
    const Turn turn = [&] {
        ++turns;
        is_held = true;
        return std::shared_ptr<void>(&is_held, [](bool* held) { *held = false; });
    };
    for (const auto accepted : {std::span<const Coding>(kBrotliFirst), std::span<const Coding>()}) {
        for (int i = 0; i < 2; ++i) {
            outputs_.document("ada", id_, "tileset.json", accepted, {}, turn);
            EXPECT_FALSE(is_held);
            EXPECT_EQ(turns, 1) << i;
        }
    }
    expect_error(ErrorCode::Conflict, "not now", [&] {
        outputs_.document(
            "ada", id_, "tileset.json", {}, {.tileset = {.error_scale = 2}},
            []() -> std::shared_ptr<void> { throw Error(ErrorCode::Conflict, "not now"); });
    });
}

TEST_F(TilesetTest, IsNotWrittenForAFileThatItDoesNotHave) {
    jobs_->succeed(lease_, {});
    document("tileset.json", 9);
    // Written anew, with one tile in a file, it would have this one.
    expect_error(ErrorCode::NotFound, "no such file of this pyramid",
                 [&] { document("tileset-1.json", 1); });
}

TEST_F(TilesetTest, IsWrittenAnewWhileLevelsAreStillToCome) {
    EXPECT_EQ(document("tileset.json", 1, kBrotliFirst).coding, Coding::Identity);
    expect_error(ErrorCode::NotFound, "no such file", [&] { document("tileset-1.json", 9); });
    document("tileset-1.json", 1);
}

TEST_F(TilesetTest, OfAJobThatFailedStaysAndItsManifestSaysWhy) {
    EXPECT_EQ(plain(document("manifest.json", 9)).find("problem"), std::string::npos);
    jobs_->fail(lease_, proto::problem_from(ErrorCode::TooLarge, "too many points"));
    const StoredFile manifest = document("manifest.json", 9);
    EXPECT_NE(plain(manifest).find(R"("complete":false)"), std::string::npos);
    EXPECT_TRUE(plain(manifest).ends_with(
        R"("problem":)" +
        proto::to_json(proto::problem_from(ErrorCode::TooLarge, "too many points")) + "}"));
    EXPECT_EQ(document("manifest.json", 9, kBrotliFirst).coding, Coding::Brotli);
    EXPECT_EQ(plain(document("manifest.json", 9, kBrotliFirst)), plain(manifest));
    // Made once: these are the same bytes, not equal ones.
    EXPECT_EQ(std::get<Bytes>(document("manifest.json", 9).content),
              std::get<Bytes>(manifest.content));
    EXPECT_NE(plain(document("tileset.json", 9)).find(".glb"), std::string::npos);
}

TEST_F(TilesetTest, OfAJobThatWasDismissedStaysAndItsManifestSaysSo) {
    jobs_->dismiss("ada", id_);
    EXPECT_NE(plain(document("manifest.json", 9)).find("the job was dismissed"), std::string::npos);
    EXPECT_NE(plain(document("tileset.json", 9)).find(".glb"), std::string::npos);
}

TEST_F(OutputsTest, ForgetsTheJobThatWasNotAskedForLongestWhereAllListTooManyFiles) {
    Outputs outputs(*jobs_, *blobs_, Links(), 200);
    std::vector<std::weak_ptr<const proto::Results>> made;
    for (int i = 0; i < 3; ++i) {
        const proto::JobDocument job =
            jobs_->submit("ada", pyramid_request(put_cloud(*jobs_, "ada", "cloud")), {}, {})
                .document;
        const Lease lease = jobs_->claim({}, 60s).value();
        proto::OutputCloud level = level_with(0, put_blob(*blobs_, "tile"));
        level.files.resize(80, level.files[0]);
        jobs_->publish_level(lease, level);
        jobs_->succeed(lease, {});
        made.emplace_back(outputs.results("ada", job.id));
    }
    EXPECT_TRUE(made[0].expired());
    EXPECT_FALSE(made[1].expired());
    EXPECT_FALSE(made[2].expired());
}

TEST(BlobCopies, GoWithTheirBlob) {
    const TemporaryFolder folder;
    const auto blobs = open_file_blob_store(folder / "blobs");
    const std::string id = put_blob(*blobs, "bytes");
    blobs->put_copy(id, "br5", bytes_of("packed"));
    EXPECT_EQ(text_of(blobs->copy(id, "br5").value()), "packed");
    EXPECT_FALSE(blobs->copy(id, "gz6"));
    EXPECT_EQ(blobs->older_than(std::chrono::system_clock::now() + 1h), std::vector{id});
    blobs->remove_copy(id, "br5");
    EXPECT_FALSE(blobs->copy(id, "br5"));

    blobs->put_copy(id, "br5", bytes_of("packed"));
    ASSERT_TRUE(blobs->remove_older(id, std::chrono::system_clock::now() + 1h));
    EXPECT_FALSE(blobs->copy(id, "br5"));
    blobs->put_copy(id, "br5", bytes_of("packed"));
    EXPECT_FALSE(blobs->copy(id, "br5"));
}

TEST(BlobCopies, AreNotBelievedWhenTheyAreDamaged) {
    const TemporaryFolder folder;
    const auto blobs = open_file_blob_store(folder / "blobs");
    const std::string id = put_blob(*blobs, "bytes");
    blobs->put_copy(id, "br5", bytes_of("packed"));
    const auto file = folder / "blobs" / id.substr(0, 2) / id.substr(2, 2) / (id + ".br5");
    std::fstream(file, std::ios::in | std::ios::out | std::ios::binary) << 'P';
    EXPECT_FALSE(blobs->copy(id, "br5"));
    std::filesystem::resize_file(file, 3);
    EXPECT_FALSE(blobs->copy(id, "br5"));
}

std::string codings(const std::string& accept) {
    http::Request request;
    request.headers.add("Accept-Encoding", accept);
    std::string names;
    for (const Coding coding : http::accepted_codings(request))
        names += (names.empty() ? "" : " ") + std::string(to_string(coding));
    return names;
}

TEST(AcceptEncoding, IsTakenByItsQualities) {
    EXPECT_EQ(codings("gzip, deflate, br"), "br gzip identity");
    EXPECT_EQ(codings("br;q=0.5, gzip"), "gzip br identity");
    EXPECT_EQ(codings("br;q=0, gzip;q=0.2"), "gzip identity");
    EXPECT_EQ(codings("BR ; q=1.000"), "br identity");
    EXPECT_EQ(codings("identity, br;q=0.9"), "identity br");
    EXPECT_EQ(codings("*"), "br gzip identity");
    EXPECT_EQ(codings("*;q=0, gzip"), "gzip");
    EXPECT_EQ(codings("gzip, *;q=0.1"), "gzip br identity");
    EXPECT_EQ(codings("identity;q=0, br"), "br");
    EXPECT_EQ(codings(""), "identity");
    EXPECT_EQ(codings("brotli, x-gzip, br;q=nonsense"), "identity");
}

TEST(AcceptEncoding, MayStandOnSeveralLines) {
    http::Request request;
    request.headers.add("Accept-Encoding", "gzip;q=0.5");
    request.headers.add("accept-encoding", "br");
    EXPECT_EQ(http::accepted_codings(request),
              (std::vector{Coding::Brotli, Coding::Gzip, Coding::Identity}));
}

TEST(Tar, HasTheHeaderOfPosix) {
    const std::string header =
        http::tar_header("manifest.json", 1234, std::chrono::sys_seconds(1'000'000'000s));
    ASSERT_EQ(header.size(), 512U);
    EXPECT_STREQ(header.data(), "manifest.json");
    EXPECT_STREQ(header.data() + 100, "0000644");
    EXPECT_STREQ(header.data() + 124, "00000002322");
    EXPECT_STREQ(header.data() + 136, "07346545000");
    EXPECT_EQ(header.substr(257, 8), std::string("ustar\0"
                                                 "00",
                                                 8));
    unsigned sum = 0;
    for (std::size_t i = 0; i < header.size(); ++i)
        sum += i >= 148 && i < 156 ? ' ' : static_cast<unsigned char>(header[i]);
    EXPECT_EQ(std::stoul(header.substr(148, 6), nullptr, 8), sum);
    EXPECT_EQ(http::tar_padding(1234).size(), 302U);
    EXPECT_EQ(http::tar_padding(1024).size(), 0U);
}

TEST(Tar, TellsSizesThatOctalDigitsCannot) {
    const std::string header = http::tar_header("level-3.ply", 10'000'000'000, {});
    EXPECT_EQ(header.substr(124, 12), std::string("\x80\0\0\0\0\0\0\x02\x54\x0B\xE4\0", 12));
}

}  // namespace
}  // namespace stipple::server
