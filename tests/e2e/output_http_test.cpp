// Clouds and results as the real stippled serves them: immutable bytes, whole or in ranges.
#include "served_jobs.hpp"

#include <gtest/gtest.h>

namespace stipple::test {
namespace {

TEST(Stippled, AnswersConditionsAndRangesOnImmutableBytes) {
    const StippledProcess server;
    const std::string bytes = as_ply(sphere(1000));
    const std::string target = "/v1/clouds/" + upload(server, bytes) + "/content";
    const std::string etag = request(server.port(), "GET", target).field("ETag");
    const auto get = [&](const std::string& field) {
        return request(server.port(), "GET", target, {}, {field});
    };

    EXPECT_EQ(get("If-None-Match: " + etag).status, 304);
    EXPECT_EQ(get("If-None-Match: \"other\"").status, 200);
    const HttpReply part = get("Range: bytes=10-19");
    EXPECT_EQ(part.status, 206);
    EXPECT_EQ(part.body, bytes.substr(10, 10));
    EXPECT_EQ(part.field("Content-Range"), "bytes 10-19/" + std::to_string(bytes.size()));
    EXPECT_EQ(get("Range: bytes=-5").body, bytes.substr(bytes.size() - 5));
    const HttpReply beyond = get("Range: bytes=99999999-");
    EXPECT_EQ(problem_of(beyond), "range-not-satisfiable");
    EXPECT_EQ(beyond.field("Content-Range"), "bytes */" + std::to_string(bytes.size()));
    EXPECT_EQ(get("Range: bytes=0-0,2-2").body, bytes);
    EXPECT_EQ(
        request(server.port(), "GET", target, {}, {"Range: bytes=0-9", "If-Range: \"other\""}).body,
        bytes);

    const HttpReply head = request(server.port(), "HEAD", target);
    EXPECT_EQ(head.status, 200);
    EXPECT_EQ(head.field("Content-Length"), std::to_string(bytes.size()));
    EXPECT_EQ(request(server.port(), "HEAD", target, {}, {"Range: bytes=0-9"}).status, 200);
}

TEST(Stippled, TellsOfTheRangesThatItTakesAndTheSameToHead) {
    const StippledProcess server;
    const std::string cloud = upload(server, as_ply(sphere(100)));
    for (const std::string target : {"/", "/docs", "/openapi.yaml", "/v1/limits", "/v1/jobs",
                                     "/v1/nothing", "/v1/clouds/content"}) {
        const HttpReply get = request(server.port(), "GET", target);
        EXPECT_EQ(get.field("Accept-Ranges"), "none") << target;
        EXPECT_EQ(request(server.port(), "HEAD", target).field("Accept-Ranges"), "none") << target;
    }
    const std::string content = "/v1/clouds/" + cloud + "/content";
    for (const char* const method : {"GET", "HEAD"})
        EXPECT_EQ(request(server.port(), method, content).field("Accept-Ranges"), "bytes");
}

TEST(Stippled, ServesAResultUnderItsOwnExtensionAlone) {
    const StippledProcess server;
    const HttpReply made =
        request(server.port(), "POST", "/v1/simplify?points=30&wait=60", as_ply(sphere(300)));
    ASSERT_EQ(made.status, 200) << made.body;
    // Link: </v1/jobs/ID>; rel="via"
    const std::string link = made.field("Link"), tag = made.field("ETag");
    const std::string file =
        link.substr(1, link.find('>') - 1) + "/results/" + tag.substr(1, tag.size() - 2);
    EXPECT_EQ(request(server.port(), "GET", file + ".ply").body, made.body);
    for (const char* const other : {"", ".", ".drc", ".png", ".ply.gz", ".copc.laz"})
        EXPECT_EQ(problem_of(request(server.port(), "GET", file + other)), "not-found") << other;
}

TEST(Stippled, ServesATilesetWhoseTilesAreThere) {
    const StippledProcess server;
    const std::string cloud = upload(server, as_ply(sphere(3000)));
    const std::string id = submit(server, {{"type", "pyramid"},
                                           {"input", cloud},
                                           {"levels", {100, 3000}},
                                           {"formats", {"glb"}},
                                           {"tiles", {{"max_points", 1000}}}});
    ASSERT_EQ(finished(server, id).at("status"), "successful");
    const std::string folder = "/v1/pyramids/" + id + "/";
    const HttpReply tileset = request(server.port(), "GET", folder + "tileset.json");
    ASSERT_EQ(tileset.status, 200) << tileset.body;
    EXPECT_EQ(tileset.field("Content-Type"), "application/json");
    EXPECT_EQ(tileset.field("Cache-Control"), "no-cache");
    EXPECT_EQ(request(server.port(), "GET", folder + "tileset.json", {},
                      {"If-None-Match: " + tileset.field("ETag")})
                  .status,
              304);
    const Json root = Json::parse(tileset.body).at("root");
    EXPECT_EQ(root.at("children").size(), 4U);
    Json tiles = root.at("children");
    tiles.push_back(root);
    std::size_t points = 0;
    for (const Json& tile : tiles) {
        const std::string uri = tile.at("content").at("uri");
        const HttpReply glb = request(server.port(), "GET", folder + uri);
        ASSERT_EQ(glb.status, 200) << glb.body;
        EXPECT_EQ(glb.field("Content-Type"), "model/gltf-binary");
        EXPECT_EQ(hash_of(glb.body) + ".glb", uri);
        EXPECT_TRUE(glb.body.starts_with("glTF"));
        points += tile.at("extras").at("points").get<std::size_t>();
    }
    EXPECT_EQ(points, 3100U);
    EXPECT_EQ(request(server.port(), "GET", folder + "tileset-1.json").status, 404);
}

TEST(Stippled, ServesAStreamOfWhichEveryRangeFromItsStartIsACloud) {
    const StippledProcess server;
    const std::string cloud = upload(server, as_ply(sphere(3000)));
    const std::string id =
        submit(server, {{"type", "pyramid"}, {"input", cloud}, {"formats", {"drc", "stpc"}}});
    ASSERT_EQ(finished(server, id).at("status"), "successful");
    const std::string target = "/v1/pyramids/" + id + "/stream";
    const HttpReply whole = request(server.port(), "GET", target);
    ASSERT_EQ(whole.status, 200) << whole.body;
    EXPECT_EQ(whole.field("Content-Type"), "application/vnd.stipple.progressive");
    EXPECT_EQ(whole.field("ETag"), '"' + hash_of(whole.body) + '"');
    EXPECT_NE(whole.field("Cache-Control").find("immutable"), std::string::npos);
    EXPECT_EQ(decode_cloud(std::as_bytes(std::span(whole.body))).size(), 3000U);
    EXPECT_EQ(
        request(server.port(), "GET", "/v1/pyramids/" + id + "/" + hash_of(whole.body) + ".stpc")
            .body,
        whole.body);

    // Who was cut off goes on where it was.
    const HttpReply first = request(server.port(), "GET", target, {}, {"Range: bytes=0-1999"});
    ASSERT_EQ(first.status, 206);
    const PointCloud few = decode_cloud(std::as_bytes(std::span(first.body)));
    EXPECT_GT(few.size(), 300U);
    EXPECT_LT(few.size(), 3000U);
    const HttpReply rest = request(server.port(), "GET", target, {}, {"Range: bytes=2000-"});
    ASSERT_EQ(rest.status, 206);
    EXPECT_EQ(first.body + rest.body, whole.body);

    const std::string other =
        submit(server, {{"type", "pyramid"}, {"input", cloud}, {"formats", {"drc"}}});
    ASSERT_EQ(finished(server, other).at("status"), "successful");
    EXPECT_EQ(request(server.port(), "GET", "/v1/pyramids/" + other + "/stream").status, 404);
}

}  // namespace
}  // namespace stipple::test
