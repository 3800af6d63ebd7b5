// Pyramids as the real stippled serves them: packed, cut, and whole.
#include "support/stippled_process.hpp"

#include "stipple/codec.hpp"
#include "stipple/proto/digest.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

namespace stipple::test {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using Json = nlohmann::json;

std::string content(const fs::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
}

/// A server with a finished pyramid, made by the command line, which wrote it into a folder, too.
class ServedPyramid : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = std::make_unique<TemporaryFolder>();
        server_ = std::make_unique<StippledProcess>();
        write_cloud(with_attributes(sphere(6000)), *folder_ / "in.ply");
        stipple("pyramid in.ply levels --levels 500,2000,6000 --tile-points 1000 --server " +
                server_->url());
        const HttpReply jobs = request(server_->port(), "GET", "/v1/jobs");
        id_ = Json::parse(jobs.body).at("items").at(0).at("id");
    }
    static void TearDownTestSuite() {
        server_.reset();
        folder_.reset();
    }

    static void stipple(const std::string& arguments) {
        const std::string command = "cd '" + folder_->path().string() + "' && '" +
                                    program("stipple").string() + "' " + arguments + " -q";
        ASSERT_EQ(std::system(command.c_str()), 0) << command;
    }
    static HttpReply get(const std::string& name, const std::vector<std::string>& fields = {},
                         const std::string& method = "GET") {
        return request(server_->port(), method, "/v1/pyramids/" + id_ + name, {}, fields);
    }
    static std::string a_tile() {
        const Json tileset = Json::parse(get("/tileset.json").body);
        return "/" + tileset.at("root").at("content").at("uri").get<std::string>();
    }

    static inline std::unique_ptr<TemporaryFolder> folder_;
    static inline std::unique_ptr<StippledProcess> server_;
    static inline std::string id_;
};

TEST_F(ServedPyramid, SendsTilesPackedUnderATagOfTheirOwn) {
    const std::string tile = a_tile();
    const HttpReply plain = get(tile);
    EXPECT_EQ(plain.field("Content-Encoding"), "");
    EXPECT_EQ(plain.field("Vary"), "Accept-Encoding");
    EXPECT_EQ(plain.field("ETag"), '"' + tile.substr(1, 64) + '"');
    EXPECT_EQ(plain.field("Cache-Control"), "public, max-age=31536000, immutable");

    HttpReply packed;
    for (int i = 0; i < 1000 && !packed.field("ETag").ends_with("-br11\""); ++i) {
        packed = get(tile, {"Accept-Encoding: gzip, br"});
        std::this_thread::sleep_for(10ms);
    }
    EXPECT_EQ(packed.field("Content-Encoding"), "br");
    EXPECT_EQ(packed.field("ETag"), '"' + tile.substr(1, 64) + "-br11\"");
    EXPECT_EQ(packed.field("Content-Type"), "model/gltf-binary");
    EXPECT_LT(packed.body.size(), plain.body.size());
    const HttpReply gzipped = get(tile, {"Accept-Encoding: gzip, br;q=0"});
    EXPECT_EQ(gzipped.field("Content-Encoding"), "gzip");
    EXPECT_NE(gzipped.field("ETag"), packed.field("ETag"));

    const auto with = [&](const std::string& etag, const std::string& accept) {
        return get(tile, {"Accept-Encoding: " + accept, "If-None-Match: " + etag}).status;
    };
    EXPECT_EQ(with(packed.field("ETag"), "br"), 304);
    EXPECT_EQ(with(gzipped.field("ETag"), "gzip"), 304);
    EXPECT_EQ(with(packed.field("ETag"), "gzip"), 200);
    EXPECT_EQ(with(plain.field("ETag"), "br"), 200);

    const HttpReply same =
        get(tile, {"Accept-Encoding: br", "If-None-Match: " + packed.field("ETag")});
    EXPECT_EQ(same.field("Content-Length"), "");
    EXPECT_EQ(same.field("Content-Encoding"), "");
    EXPECT_EQ(same.field("ETag"), packed.field("ETag"));
    EXPECT_EQ(same.field("Vary"), "Accept-Encoding");

    const HttpReply part = get(tile, {"Accept-Encoding: br", "Range: bytes=4-11"});
    EXPECT_EQ(part.status, 206);
    EXPECT_EQ(part.field("Content-Encoding"), "");
    EXPECT_EQ(part.body, plain.body.substr(4, 8));
}

TEST_F(ServedPyramid, SendsDocumentsPackedAndAsksThemToBeAskedAbout) {
    for (const std::string name : {"/manifest.json", "/tileset.json"}) {
        const HttpReply plain = get(name), packed = get(name, {"Accept-Encoding: br"});
        EXPECT_EQ(packed.field("Content-Encoding"), "br") << name;
        EXPECT_EQ(packed.field("Vary"), "Accept-Encoding") << name;
        EXPECT_EQ(packed.field("Cache-Control"), "no-cache") << name;
        EXPECT_NE(packed.field("ETag"), plain.field("ETag")) << name;
        EXPECT_LT(packed.body.size(), plain.body.size()) << name;
        EXPECT_EQ(
            get(name, {"Accept-Encoding: br", "If-None-Match: " + packed.field("ETag")}).status,
            304)
            << name;
    }
}

TEST_F(ServedPyramid, TellsItsTilesetByTheErrorThatIsAskedFor) {
    const HttpReply plain = get("/tileset.json");
    std::map<std::string, std::string> tags{{plain.field("ETag"), ""}};
    const Json tile = Json::parse(plain.body).at("root");
    const auto error_of = [](const HttpReply& reply) {
        return Json::parse(reply.body).at("root").at("geometricError").get<double>();
    };
    // Where spacings are the larger, as here, error=spacing is the same as the default.
    for (const std::string query : {"error=avg", "error=p99", "errorScale=2",
                                    "error=avg&errorScale=2", "error=avg&inline=glb"}) {
        const HttpReply reply = get("/tileset.json?" + query);
        ASSERT_EQ(reply.status, 200) << query;
        EXPECT_TRUE(tags.emplace(reply.field("ETag"), query).second) << query;
        EXPECT_EQ(Json::parse(reply.body).at("root").at("extras"), tile.at("extras")) << query;
        EXPECT_EQ(get("/tileset.json?" + query, {"If-None-Match: " + reply.field("ETag")}).status,
                  304);
    }
    const double spacing = tile.at("extras").at("spacing");
    EXPECT_GE(error_of(get("/tileset.json?error=spacing")), spacing);
    EXPECT_DOUBLE_EQ(error_of(get("/tileset.json?errorScale=2")), 2 * error_of(plain));
    EXPECT_LT(error_of(get("/tileset.json?error=avg")), error_of(plain));
    EXPECT_EQ(get("/tileset.json?error=max").field("ETag"), plain.field("ETag"));
    for (const std::string wrong :
         {"/tileset.json?error=mean", "/tileset.json?errorScale=0", "/tileset.json?errorScale=-1",
          "/tileset.json?errorScale=inf", "/tileset.json?errorscale=2", "/tileset.json?inline=drc",
          "/manifest.json?error=avg", "/manifest.json?inlined=drc"}) {
        const HttpReply reply = get(wrong);
        EXPECT_EQ(reply.status, 400) << wrong;
        EXPECT_EQ(reply.field("Content-Type"), "application/problem+json") << wrong;
    }
}

TEST_F(ServedPyramid, IsReadableFromAnySite) {
    const HttpReply reply = get(a_tile(), {"Origin: https://example.org"});
    EXPECT_EQ(reply.field("Access-Control-Allow-Origin"), "*");
    EXPECT_EQ(reply.field("Timing-Allow-Origin"), "*");
    for (const char* const name : {"ETag", "Content-Length", "Content-Range", "Stipple-Points"}) {
        EXPECT_NE(reply.field("Access-Control-Expose-Headers").find(name), std::string::npos)
            << name;
    }
    const HttpReply asked = get("/slice", {"Origin: https://example.org"}, "OPTIONS");
    EXPECT_EQ(asked.field("Access-Control-Allow-Methods"), "GET, HEAD, OPTIONS");
}

TEST_F(ServedPyramid, CutsACloudByBudgetAndPlace) {
    const HttpReply reply = get("/slice?points=700&box=0,0,0,1,1,1&format=drc");
    ASSERT_EQ(reply.status, 200) << reply.body;
    EXPECT_EQ(reply.field("Content-Type"), "model/vnd.google.draco");
    EXPECT_EQ(reply.field("Stipple-Points"), "700");
    EXPECT_EQ(reply.field("Stipple-Level"), "2");
    EXPECT_GT(std::stod(reply.field("Stipple-Error-Mean")), 0);
    EXPECT_EQ(decode_cloud(std::as_bytes(std::span(reply.body))).size(), 700U);
    EXPECT_EQ(get("/slice?points=700&box=0,0,0,1,1,1&format=drc",
                  {"If-None-Match: " + reply.field("ETag")})
                  .status,
              304);
    EXPECT_GT(get("/slice?points=700&format=drc&position_bits=0").body.size(),
              get("/slice?points=700&format=drc").body.size());
    EXPECT_EQ(get("/slice?points=700&position_bits=0").status, 400);
    EXPECT_LE(get("/slice?bytes=9000").body.size(), 9000U);
    EXPECT_EQ(get("/slice?max_error=0.5").field("Stipple-Level"), "0");

    for (const std::string wrong :
         {"", "?points=1&bytes=1", "?points=0", "?points=x", "?max_error=-1", "?points=9&box=1,2",
          "?points=9&box=0,0,0,1,1,1,1", "?points=9&box=1,0,0,0,1,1", "?points=9&format=las",
          "?pionts=9"}) {
        EXPECT_EQ(get("/slice" + wrong).status / 100, 4) << wrong;
        EXPECT_EQ(get("/slice" + wrong).field("Content-Type"), "application/problem+json") << wrong;
    }
    EXPECT_EQ(get("/slice?points=9&box=5,5,5,6,6,6").status, 404);
}

TEST_F(ServedPyramid, TellsTheOriginOfADracoSliceOfDoubleCoordinatesAlone) {
    EXPECT_EQ(get("/slice?points=70&format=drc").field("Stipple-Origin"), "");
    PointCloud far = sphere(2000);
    far.origin = Vec3d(500'000, 5'000'000, 100);
    write_cloud(far, *folder_ / "far.ply");
    stipple("pyramid far.ply far --levels 500,2000 --formats drc,glb --server " + server_->url());
    const Json jobs = Json::parse(request(server_->port(), "GET", "/v1/jobs").body).at("items");
    const auto id_of = [](const Json& job) { return job.at("id").get<std::string>(); };
    const auto made =
        std::ranges::find_if(jobs, [&](const Json& job) { return id_of(job) != id_; });
    ASSERT_NE(made, jobs.end());
    const std::string slice = "/v1/pyramids/" + id_of(*made) + "/slice?points=70&format=";
    const HttpReply draco = request(server_->port(), "GET", slice + "drc");
    const PointCloud cut = decode_cloud(std::as_bytes(std::span(draco.body)));
    ASSERT_FALSE(cut.origin.isZero());
    const Json origin = Json::parse('[' + draco.field("Stipple-Origin") + ']');
    for (std::size_t axis = 0; axis < 3; ++axis) EXPECT_EQ(origin.at(axis), cut.origin[axis]);
    EXPECT_EQ(request(server_->port(), "GET", slice + "ply").field("Stipple-Origin"), "");
}

TEST_F(ServedPyramid, IsCutByTheCommandLineHereAndThere) {
    stipple("slice levels here.ply --points 1234");
    stipple("slice " + id_ + " there.ply --points 1234 --server " + server_->url());
    EXPECT_EQ(read_cloud(*folder_ / "here.ply").size(), 1234U);
    EXPECT_EQ(content(*folder_ / "here.ply"), content(*folder_ / "there.ply"));
}

TEST_F(ServedPyramid, IsExportedAsTheCommandLineWritesIt) {
    const HttpReply reply = get(".tar");
    ASSERT_EQ(reply.status, 200) << reply.body;
    EXPECT_EQ(reply.field("Content-Type"), "application/x-tar");
    EXPECT_EQ(reply.field("Content-Length"), std::to_string(reply.body.size()));
    const fs::path exported = *folder_ / "exported";
    fs::create_directory(exported);
    std::ofstream(exported / "all.tar", std::ios::binary) << reply.body;
    ASSERT_EQ(std::system(("tar -C '" + exported.string() + "' -xf '" +
                           (exported / "all.tar").string() + "'")
                              .c_str()),
              0);
    fs::remove(exported / "all.tar");
    std::map<std::string, std::string> written, unpacked;
    for (const auto& file : fs::directory_iterator(*folder_ / "levels"))
        written[file.path().filename().string()] = content(file.path());
    for (const auto& file : fs::directory_iterator(exported))
        unpacked[file.path().filename().string()] = content(file.path());
    EXPECT_GT(written.size(), 10U);
    EXPECT_TRUE(written == unpacked);
    EXPECT_EQ(unpacked["manifest.json"].find("/v1/"), std::string::npos);
}

TEST_F(ServedPyramid, IsExportedToProxiesThatKnowNoChunks) {
    const auto sent = [](const char* target) {
        RawConnection connection(server_->port());
        connection.send("GET " + (target + id_) + ".tar HTTP/1.0\r\n\r\n");
        return connection.receive();
    };
    const HttpReply reply = sent("/v1/pyramids/");
    EXPECT_EQ(reply.status, 200);
    EXPECT_EQ(reply.field("Transfer-Encoding"), "");
    EXPECT_EQ(reply.field("Connection"), "close");
    EXPECT_TRUE(reply.body == get(".tar").body);
}

TEST_F(ServedPyramid, IsToldAsTheResultsOfItsJobToo) {
    const HttpReply manifest = get("/manifest.json");
    const HttpReply results = request(server_->port(), "GET", "/v1/jobs/" + id_ + "/results");
    EXPECT_EQ(results.status, 200);
    EXPECT_EQ(results.body, manifest.body);
    EXPECT_EQ(results.field("ETag"), manifest.field("ETag"));
}

TEST_F(ServedPyramid, IsNotThereUnderAnotherName) {
    const HttpReply reply =
        request(server_->port(), "GET", "/v1/pyramids/" + std::string(32, '0') + ".tar");
    EXPECT_EQ(reply.status, 404);
    EXPECT_EQ(request(server_->port(), "GET", "/v1/pyramids/.tar").status, 404);
}

}  // namespace
}  // namespace stipple::test
