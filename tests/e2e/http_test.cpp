// The real stippled over HTTP: what a client may rely on.
#include "support/stippled_process.hpp"

#include "stipple/codec.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/simplify.hpp"

#include <gtest/gtest.h>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

namespace stipple::test {
namespace {

using namespace std::chrono_literals;
using Json = nlohmann::json;

std::string as_ply(const PointCloud& cloud) {
    const auto bytes = encode_ply(cloud);
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::string hash_of(const std::string& bytes) {
    return proto::sha256_hex(std::as_bytes(std::span(bytes)));
}

const std::vector<std::string> kJson = {"Content-Type: application/json"};

/// Uploads a cloud; returns its id.
std::string upload(const StippledProcess& server, const std::string& bytes) {
    const HttpReply reply = request(server.port(), "POST", "/v1/clouds", bytes);
    EXPECT_TRUE(reply.status == 201 || reply.status == 200) << reply.body;
    return Json::parse(reply.body).at("id");
}

std::string submit(const StippledProcess& server, const Json& job,
                   std::vector<std::string> fields = kJson) {
    const HttpReply reply = request(server.port(), "POST", "/v1/jobs", job.dump(), fields);
    EXPECT_TRUE(reply.status == 201 || reply.status == 200) << reply.body;
    return Json::parse(reply.body).at("id");
}

Json pyramid_of(const std::string& cloud) {
    return {
        {"type", "pyramid"}, {"input", cloud}, {"levels", {100, 500}}, {"formats", {"drc", "ply"}}};
}

/// The document of a job once it is final.
Json finished(const StippledProcess& server, const std::string& id) {
    for (int attempt = 0; attempt < 20; ++attempt) {
        const Json job =
            Json::parse(request(server.port(), "GET", "/v1/jobs/" + id + "?wait=10").body);
        const std::string status = job.at("status");
        if (status != "accepted" && status != "running") return job;
    }
    ADD_FAILURE() << "job " << id << " did not end";
    return {};
}

/// The type of a problem, without its base; what else a problem must have is checked.
std::string problem_of(const HttpReply& reply) {
    EXPECT_EQ(reply.field("Content-Type"), "application/problem+json") << reply.head << reply.body;
    const Json problem = Json::parse(reply.body, nullptr, false);
    if (!problem.is_object()) return "no problem document";
    EXPECT_EQ(problem.at("status"), reply.status);
    EXPECT_FALSE(problem.at("detail").get<std::string>().empty());
    const std::string type = problem.at("type");
    return type.substr(type.rfind('/') + 1);
}

TEST(Stippled, TurnsAnUploadIntoAPyramidWhoseBytesAreWhatTheManifestSays) {
    const StippledProcess server;
    const std::string bytes = as_ply(with_attributes(sphere(2000)));
    const HttpReply uploaded = request(server.port(), "POST", "/v1/clouds", bytes);
    EXPECT_EQ(uploaded.status, 201) << uploaded.body;
    EXPECT_EQ(uploaded.field("Location"), "/v1/clouds/" + hash_of(bytes));
    const HttpReply again =
        request(server.port(), "POST", "/v1/clouds?name=Caf%C3%A9+scan.ply", bytes);
    EXPECT_EQ(again.status, 200);
    EXPECT_EQ(Json::parse(again.body).at("name"), "Café scan.ply");

    const std::string id = submit(server, pyramid_of(hash_of(bytes)));
    const Json job = finished(server, id);
    ASSERT_EQ(job.at("status"), "successful") << job.dump();
    EXPECT_EQ(job.at("progress"), 100);
    EXPECT_EQ(job.at("input_name"), "Café scan.ply");

    const Json manifest =
        Json::parse(request(server.port(), "GET", "/v1/pyramids/" + id + "/manifest.json").body);
    EXPECT_TRUE(manifest.at("complete"));
    ASSERT_EQ(manifest.at("levels").size(), 2U);
    for (const Json& level : manifest.at("levels")) {
        for (const Json& file : level.at("files")) {
            const HttpReply reply = request(server.port(), "GET", file.at("href"));
            ASSERT_EQ(reply.status, 200) << reply.body;
            EXPECT_EQ(hash_of(reply.body), file.at("sha256"));
            EXPECT_EQ(reply.field("ETag"), '"' + file.at("sha256").get<std::string>() + '"');
            const PointCloud cloud = decode_cloud(std::as_bytes(std::span(reply.body)));
            EXPECT_EQ(cloud.size(), level.at("points"));
        }
    }
    const Json cloud =
        Json::parse(request(server.port(), "GET", "/v1/clouds/" + hash_of(bytes)).body);
    EXPECT_EQ(cloud.at("points"), 2000);
    EXPECT_EQ(request(server.port(), "GET", "/v1/clouds/" + hash_of(bytes) + "/content").body,
              bytes);
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

TEST(Stippled, StreamsEventsToTheFinalStatusAndResumesWhereAStreamWasCut) {
    const StippledProcess server;
    const std::string id = submit(server, pyramid_of(upload(server, as_ply(sphere(2000)))));
    const HttpReply all = request(server.port(), "GET", "/v1/jobs/" + id + "/events");
    EXPECT_EQ(all.field("Content-Type"), "text/event-stream");
    EXPECT_EQ(all.field("X-Accel-Buffering"), "no");
    EXPECT_NE(all.body.find("event: level\ndata: {\"level\":"), std::string::npos) << all.body;
    EXPECT_NE(all.body.find("\"href\":\"/v1/pyramids/" + id), std::string::npos) << all.body;
    EXPECT_TRUE(all.body.ends_with("data: {\"status\":\"successful\"}\n\n")) << all.body;

    RawConnection old(server.port());  // as a proxy speaks that knows no chunks
    old.send("GET /v1/jobs/" + id + "/events HTTP/1.0\r\n\r\n");
    EXPECT_EQ(old.receive().body, all.body);

    const HttpReply rest =
        request(server.port(), "GET", "/v1/jobs/" + id + "/events", {}, {"Last-Event-ID: 2"});
    EXPECT_EQ(rest.body.find("\nid: 2\n"), std::string::npos);
    EXPECT_NE(rest.body.find("\nid: 3\n"), std::string::npos) << rest.body;
    EXPECT_EQ(request(server.port(), "GET", "/v1/jobs/" + id + "/events?after=100000").status, 204);
    EXPECT_EQ(request(server.port(), "GET", "/v1/jobs/" + id + "/events", {},
                      {"Last-Event-ID: 9223372036854775808"})
                  .status,
              400);
    EXPECT_EQ(problem_of(request(server.port(), "GET", "/v1/jobs/nowhere/events")), "not-found");
}

TEST(Stippled, SimplifiesInOneCall) {
    const StippledProcess server;
    const std::string bytes = as_ply(sphere(3000));
    const HttpReply ply = request(server.port(), "POST", "/v1/simplify?points=300&wait=60", bytes);
    ASSERT_EQ(ply.status, 200) << ply.body;
    EXPECT_EQ(ply.field("Content-Type"), "model/ply");
    EXPECT_EQ(ply.field("Stipple-Points"), "300");
    const PointCloud cloud = decode_cloud(std::as_bytes(std::span(ply.body)));
    EXPECT_EQ(cloud.size(), 300U);
    EXPECT_NE(find_attribute(cloud, "radius"), nullptr);

    for (const Method method : kMethods) {
        const std::string target =
            "/v1/simplify?points=300&wait=60&splats=none&source_index=true&"
            "method=" +
            std::string(to_string(method));
        const HttpReply reply = request(server.port(), "POST", target, bytes);
        ASSERT_EQ(reply.status, 200) << target << reply.body;
        const PointCloud result = decode_cloud(std::as_bytes(std::span(reply.body)));
        EXPECT_EQ(result.size(), 300U) << target;
        EXPECT_NE(find_attribute(result, "source_index"), nullptr) << target;
        EXPECT_EQ(find_attribute(result, "radius"), nullptr) << target;
    }
    const HttpReply voxels =
        request(server.port(), "POST", "/v1/simplify?method=voxel&voxel_size=0.25&wait=60", bytes);
    EXPECT_EQ(voxels.status, 200) << voxels.body;

    const HttpReply bounded = request(
        server.port(), "POST", "/v1/simplify?method=hierarchical&max_error=5%25&wait=60", bytes);
    EXPECT_EQ(bounded.status, 200) << bounded.body;
    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/simplify?max_error=0", bytes)),
              "invalid-argument");

    const HttpReply draco = request(server.port(), "POST", "/v1/simplify?ratio=0.1&wait=60", bytes,
                                    {"Accept: model/vnd.google.draco"});
    ASSERT_EQ(draco.status, 200) << draco.body;
    EXPECT_EQ(draco.body.substr(0, 5), "DRACO");
    const auto begin_of = [&](const char* query, const char* accept) {
        return request(server.port(), "POST", std::string("/v1/simplify?wait=60&points=30") + query,
                       bytes, {std::string("Accept: ") + accept})
            .body.substr(0, 4);
    };
    EXPECT_EQ(begin_of("", "model/ply;q=0.5, model/vnd.google.draco, */*;q=0.1"), "DRAC");
    EXPECT_EQ(begin_of("", "model/vnd.google.draco;q=0, model/*"), "ply\n");
    EXPECT_EQ(begin_of("&format=drc", "text/html"), "DRAC");

    const HttpReply later = request(server.port(), "POST", "/v1/simplify?points=300&wait=0", bytes);
    EXPECT_EQ(later.status, 201) << later.body;
    EXPECT_EQ(finished(server, Json::parse(later.body).at("id")).at("status"), "successful");

    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/simplify?points=0", bytes)),
              "invalid-argument");
    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/simplify?pionts=9", bytes)),
              "invalid-argument");
    EXPECT_EQ(problem_of(request(server.port(), "POST",
                                 "/v1/simplify?points=9&source_index=perhaps", bytes)),
              "invalid-argument");
    const HttpReply misplaced =
        request(server.port(), "POST", "/v1/simplify?points=9&voxel_size=1", bytes);
    EXPECT_EQ(problem_of(misplaced), "invalid-argument");
    EXPECT_NE(misplaced.body.find("voxel_size: belongs to voxel, not to multiphase"),
              std::string::npos)
        << misplaced.body;
    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/simplify?points=9", bytes,
                                 {"Accept: image/png"})),
              "not-acceptable");
    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/simplify?points=9&wait=60",
                                 "ply\nnonsense\n")),
              "malformed-input");
}

TEST(Stippled, UpsamplesAndAnalyzesByJobs) {
    const StippledProcess server;
    const std::string input = upload(server, as_ply(sphere(1000)));
    const auto made_by = [&](const Json& wanted) {
        const std::string id = submit(server, wanted);
        const Json job = finished(server, id);
        EXPECT_EQ(job.at("status"), "successful") << job.dump();
        const Json results =
            Json::parse(request(server.port(), "GET", "/v1/jobs/" + id + "/results").body);
        EXPECT_EQ(results.at("schema"), "stipple-results/1");
        EXPECT_EQ(results.contains("method"), wanted.at("type") != "analyze");
        const HttpReply file =
            request(server.port(), "GET", results.at("levels").at(0).at("files").at(0).at("href"));
        return decode_cloud(std::as_bytes(std::span(file.body)));
    };
    EXPECT_EQ(made_by({{"type", "upsample"}, {"input", input}, {"ratio", 3}}).size(), 3000U);
    const PointCloud analyzed = made_by({{"type", "analyze"}, {"input", input}});
    EXPECT_EQ(analyzed.size(), 1000U);
    EXPECT_EQ(analyzed.normals.size(), 1000U);
    EXPECT_NE(find_attribute(analyzed, "variation"), nullptr);

    const auto listed = [&](const std::string& type) {
        const HttpReply reply = request(server.port(), "GET", "/v1/jobs?type=" + type);
        return reply.status == 200 ? Json::parse(reply.body).at("items").size() : 99U;
    };
    EXPECT_EQ(listed("upsample"), 1U);
    EXPECT_EQ(listed("analyze"), 1U);
    EXPECT_EQ(listed("simplify"), 0U);
    EXPECT_EQ(listed("magic"), 99U);
}

TEST(Stippled, EvaluatesCloudsAndResultsInOneCall) {
    const StippledProcess server;
    const PointCloud reference = sphere(3000);
    PointCloud larger = reference;
    for (Vec3f& p : larger.positions) p *= 1.1F;
    const std::string id = upload(server, as_ply(reference));
    const std::string candidate = upload(server, as_ply(larger));
    const auto evaluate = [&](const Json& body) {
        return request(server.port(), "POST", "/v1/evaluations?wait=60", body.dump(), kJson);
    };
    const HttpReply one =
        evaluate({{"reference", id}, {"candidate", candidate}, {"samples", 3000}});
    ASSERT_EQ(one.status, 200) << one.body;
    const Json figures = Json::parse(one.body);
    EXPECT_NEAR(figures.at("mean").get<double>(), 0.1, 0.002);
    EXPECT_EQ(figures.at("candidate").at("id"), candidate);
    EXPECT_NE(one.field("Link").find("/v1/jobs/"), std::string::npos);

    // A file that another job made is as good as a cloud; it is drawn in the sandbox.
    const std::string job = submit(server, pyramid_of(id));
    ASSERT_EQ(finished(server, job).at("status"), "successful");
    const Json levels =
        Json::parse(request(server.port(), "GET", "/v1/jobs/" + job + "/results").body)
            .at("levels");
    EXPECT_GT(levels[0].at("error").at("mean").get<double>(), 0);
    const HttpReply two = evaluate({{"reference", id},
                                    {"candidates", {levels[0]["files"][0]["sha256"], candidate}},
                                    {"samples", 3000},
                                    {"map", {"drc"}},
                                    {"pictures", true},
                                    {"views", {"front", "top"}}});
    ASSERT_EQ(two.status, 200) << two.body;
    const Json both = Json::parse(two.body);
    EXPECT_EQ(both.at("candidates")[1].at("mean"), figures.at("mean"));
    EXPECT_EQ(both.at("candidates")[0].at("candidate").at("points"), 100);
    const HttpReply map =
        request(server.port(), "GET", both.at("candidates")[1].at("files")[0].at("href"));
    EXPECT_NE(find_attribute(decode_cloud(std::as_bytes(std::span(map.body))), "distance"),
              nullptr);
    const HttpReply picture = request(server.port(), "GET", both.at("pictures")[0].at("href"));
    EXPECT_EQ(picture.field("Content-Type"), "image/png");
    EXPECT_EQ(hash_of(picture.body), both.at("pictures")[0].at("sha256"));

    EXPECT_EQ(problem_of(evaluate({{"reference", id}, {"candidate", std::string(64, '0')}})),
              "not-found");
    EXPECT_EQ(problem_of(evaluate({{"reference", id}})), "invalid-argument");
}

TEST(Stippled, SaysWhyCloudsCannotBeCompared) {
    const StippledProcess server;
    const std::string id = upload(server, as_ply(sphere(1000)));
    const auto evaluate = [&](const std::string& reference, const std::string& candidate) {
        const Json body = {{"reference", reference}, {"candidate", candidate}};
        return request(server.port(), "POST", "/v1/evaluations?wait=60", body.dump(), kJson);
    };
    const auto warnings_of = [&](const PointCloud& cloud) {
        const HttpReply reply = evaluate(id, upload(server, as_ply(cloud)));
        return reply.status == 200 ? Json::parse(reply.body).at("warnings").dump() : reply.body;
    };
    for (const float scale : {1000.0F, 0.001F}) {
        PointCloud other = sphere(1000);
        for (Vec3f& p : other.positions) p *= scale;
        EXPECT_NE(warnings_of(other).find("same unit"), std::string::npos) << scale;
    }
    EXPECT_NE(warnings_of(sphere(7)).find("candidate of 7 points"), std::string::npos);

    const std::string empty = upload(server, as_ply(PointCloud{}));
    const HttpReply candidate = evaluate(id, empty), reference = evaluate(empty, id);
    EXPECT_EQ(problem_of(candidate), "malformed-input");
    EXPECT_EQ(Json::parse(candidate.body).at("candidate"), 1);
    EXPECT_EQ(Json::parse(candidate.body).at("detail"), "the file holds no points");
    EXPECT_EQ(problem_of(reference), "malformed-input");
    EXPECT_NE(reference.body.find("no points"), std::string::npos) << reference.body;
}

TEST(Stippled, ReturnsTheSameJobForTheSameIdempotencyKey) {
    const StippledProcess server;
    const Json job = pyramid_of(upload(server, as_ply(sphere(500))));
    const std::vector<std::string> keyed = {"Content-Type: application/json",
                                            "Idempotency-Key: mine"};
    const std::string id = submit(server, job, keyed);
    EXPECT_EQ(submit(server, job, keyed), id);
    Json other = job;
    other["levels"] = {7};
    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/jobs", other.dump(), keyed)),
              "conflict");
}

TEST(Stippled, RefusesByAProblemThatSaysWhy) {
    const StippledProcess server({"--max-upload", "1000"});
    const auto ask = [&server](const char* method, const char* target, const std::string& body = {},
                               std::vector<std::string> fields = {}) {
        return problem_of(request(server.port(), method, target, body, fields));
    };
    EXPECT_EQ(ask("GET", "/v1/nothing"), "not-found");
    EXPECT_EQ(ask("GET", "/v1/jobs/0"), "not-found");
    EXPECT_EQ(ask("PUT", "/v1/jobs"), "method-not-allowed");
    EXPECT_EQ(ask("GET", "/v1/jobs?limit=0"), "invalid-argument");
    EXPECT_EQ(ask("GET", "/v1/jobs?status=odd"), "invalid-argument");
    EXPECT_EQ(ask("GET", "/v1/jobs?limit=1&limit=2"), "invalid-argument");
    EXPECT_EQ(ask("GET", "/v1/jobs/0?wiat=1"), "invalid-argument");
    EXPECT_EQ(ask("GET", "/v1/jobs/0/events?afetr=1"), "invalid-argument");
    EXPECT_EQ(ask("DELETE", "/v1/jobs/0?only=finished"), "invalid-argument");
    EXPECT_EQ(ask("DELETE", "/v1/clouds/0?force=1"), "invalid-argument");
    EXPECT_EQ(ask("POST", "/v1/simplify?points=1&format=ply&position_bits=9", "ply"),
              "invalid-argument");
    EXPECT_EQ(ask("POST", "/v1/clouds?title=scan", "ply"), "invalid-argument");
    EXPECT_EQ(ask("POST", "/v1/clouds?name=", "ply"), "invalid-argument");
    EXPECT_EQ(ask("POST", "/v1/clouds?name=a%0Ab", "ply"), "invalid-argument");
    EXPECT_EQ(ask("POST", "/v1/clouds", "neither"), "unsupported-format");
    EXPECT_EQ(ask("POST", "/v1/clouds", "\x1f\x8b packed"), "unsupported-format");
    EXPECT_EQ(ask("POST", "/v1/clouds", "ply" + std::string(2000, ' ')), "too-large");
    EXPECT_EQ(ask("POST", "/v1/jobs", "{"), "unsupported-format");
    EXPECT_EQ(ask("POST", "/v1/jobs", "{", kJson), "invalid-argument");
    EXPECT_EQ(ask("POST", "/v1/jobs", "[]",
                  {"Content-Type: application/json", "Origin: http://evil.example"}),
              "forbidden");
    EXPECT_EQ(request(server.port(), "PUT", "/v1/jobs").field("Allow"), "POST, GET, HEAD, OPTIONS");
}

TEST(Stippled, NamesWhatIsWrongWithAQueryAndItsValue) {
    const StippledProcess server;
    const auto detail = [&server](const char* method, const char* target) {
        const HttpReply reply = request(server.port(), method, target);
        EXPECT_EQ(reply.status, 400) << target;
        return Json::parse(reply.body).at("detail").get<std::string>();
    };
    EXPECT_EQ(detail("GET", "/v1/jobs?type=magic"),
              "type \"magic\": expected simplify, pyramid, upsample, analyze, curve or evaluate");
    EXPECT_EQ(detail("GET", "/v1/jobs?input=7"),
              "input \"7\": expected the id of a cloud, 64 hexadecimal digits");
    EXPECT_TRUE(
        detail("GET", "/v1/jobs?status=odd").starts_with("status \"odd\": expected one of"));
    EXPECT_EQ(detail("DELETE", "/v1/jobs/0?only=finished"),
              "only \"finished\": expected unfinished");
    EXPECT_TRUE(detail("GET", "/v1/jobs?cursor=a%00b").starts_with("cursor \"a?b\": expected the"));
}

TEST(Stippled, RefusesAParameterThatComesTwiceLikeAnyOther) {
    const StippledProcess server({"--cors-origin", "*"});
    const HttpReply reply = request(server.port(), "GET", "/v1/jobs?limit=1&limit=2", {},
                                    {"X-Request-Id: mine", "Origin: https://app.example"});
    EXPECT_EQ(problem_of(reply), "invalid-argument");
    EXPECT_EQ(reply.field("X-Request-Id"), "mine");
    EXPECT_EQ(reply.field("Access-Control-Allow-Origin"), "https://app.example");
    const std::string cloud = upload(server, as_ply(sphere(100)));
    EXPECT_EQ(request(server.port(), "GET", "/v1/clouds/" + cloud + "/content?v=1&v=2").status,
              200);
}

TEST(Stippled, NamesARequestThatItCannotReadAsItsCallerDoes) {
    const StippledProcess server;
    for (const char* const line :
         {"GET /v1/limits HTTP/2.0", "BREW / HTTP/1.1", "GET x HTTP/1.1"}) {
        RawConnection connection(server.port());
        connection.send(std::string(line) + "\r\nHost: h\r\nX-Request-Id: mine\r\n\r\n");
        EXPECT_EQ(connection.receive().field("X-Request-Id"), "mine") << line;
    }
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

TEST(Stippled, SaysWhyNoMoreLevelsComeOfAJobThatWasDismissedOrFailed) {
    const StippledProcess server;
    const std::string failed = submit(server, pyramid_of(upload(server, "ply\nnonsense\n")));
    ASSERT_EQ(finished(server, failed).at("status"), "failed");
    const HttpReply manifest =
        request(server.port(), "GET", "/v1/pyramids/" + failed + "/manifest.json");
    ASSERT_EQ(manifest.status, 200) << manifest.body;
    EXPECT_FALSE(Json::parse(manifest.body).at("complete"));
    EXPECT_EQ(Json::parse(manifest.body).at("problem").at("status"), 422);

    const StippledProcess idle({"--role", "api"});
    const std::string id = submit(idle, pyramid_of(upload(idle, as_ply(sphere(100)))));
    const std::string target = "/v1/pyramids/" + id + "/manifest.json";
    EXPECT_FALSE(Json::parse(request(idle.port(), "GET", target).body).contains("problem"));
    ASSERT_EQ(request(idle.port(), "DELETE", "/v1/jobs/" + id).status, 200);
    const Json told = Json::parse(request(idle.port(), "GET", target).body);
    EXPECT_FALSE(told.at("complete"));
    EXPECT_EQ(told.at("problem").at("status"), 409);
    EXPECT_EQ(problem_of(request(idle.port(), "GET", "/v1/jobs/" + id + "/results")), "conflict");
}

TEST(Stippled, CancelsNoJobThatHasEnded) {
    const StippledProcess server;
    const std::string id = submit(server, pyramid_of(upload(server, as_ply(sphere(2000)))));
    EXPECT_EQ(finished(server, id).at("status"), "successful");
    const std::string job = "/v1/jobs/" + id;
    EXPECT_EQ(problem_of(request(server.port(), "DELETE", job + "?only=unfinished")), "conflict");
    EXPECT_EQ(request(server.port(), "GET", job).status, 200);
    EXPECT_EQ(request(server.port(), "DELETE", job).status, 200);
    EXPECT_EQ(request(server.port(), "GET", job).status, 404);
}

/// What a browser says of the server after the owner of a domain had it lead to this machine.
TEST(Stippled, AnswersToNoDomainButThoseItWasToldOf) {
    const StippledProcess server({"--host-name", "scans.example"});
    const auto status_as = [&](const std::string& host) {
        RawConnection connection(server.port());
        connection.send("GET /v1/clouds HTTP/1.1\r\nHost: " + host + "\r\n\r\n");
        return connection.receive().status;
    };
    for (const char* host : {"localhost:8080", "127.0.0.1", "[::1]:8080", "viewer.localhost",
                             "stippled:8080", "Scans.example:80"})
        EXPECT_EQ(status_as(host), 200) << host;
    for (const char* host : {"evil.example", "evil.example:8080", "127.0.0.1.evil.example"})
        EXPECT_EQ(status_as(host), 421) << host;
}

TEST(Stippled, TellsCachesThatWhatItSharesDependsOnTheSite) {
    const StippledProcess server({"--cors-origin", "https://app.example"});
    const HttpReply own = request(server.port(), "GET", "/v1/clouds");
    EXPECT_EQ(own.field("Vary"), "Origin");
    EXPECT_EQ(own.field("Access-Control-Allow-Origin"), "");
    const HttpReply asked =
        request(server.port(), "OPTIONS", "/v1/clouds", {}, {"Origin: https://app.example"});
    EXPECT_NE(asked.field("Access-Control-Allow-Headers").find("If-Range"), std::string::npos);
    const HttpReply shared =
        request(server.port(), "GET", "/v1/clouds", {}, {"Origin: https://app.example"});
    EXPECT_EQ(shared.field("Vary"), "Origin");
    EXPECT_EQ(shared.field("Access-Control-Allow-Origin"), "https://app.example");
}

TEST(Stippled, ServesItsContractItsDocsAndItsLimits) {
    const StippledProcess server({"--max-upload", "1000"});
    EXPECT_TRUE(request(server.port(), "GET", "/openapi.yaml").body.starts_with("openapi: 3.1"));
    const HttpReply docs = request(server.port(), "GET", "/docs");
    EXPECT_NE(docs.body.find("/v1/pyramids/{id}/{file}"), std::string::npos);
    EXPECT_NE(docs.field("Content-Security-Policy").find("default-src 'none'"), std::string::npos);
    EXPECT_EQ(Json::parse(request(server.port(), "GET", "/v1/limits").body).at("max_upload_bytes"),
              1000);
    EXPECT_EQ(request(server.port(), "OPTIONS", "/v1/limits").field("Access-Control-Allow-Origin"),
              "*");
    EXPECT_EQ(request(server.port(), "GET", "/v1/limits", {}, {"X-Request-Id: a.b-c"})
                  .field("X-Request-Id"),
              "a.b-c");
}

TEST(Stippled, TellsOperatorsHowItIs) {
    const StippledProcess server;
    EXPECT_EQ(request(server.admin_port(), "GET", "/livez").status, 200);
    EXPECT_EQ(request(server.admin_port(), "GET", "/readyz").status, 200);
    request(server.port(), "GET", "/v1/limits");
    EXPECT_EQ(request(server.port(), "POST", "/v1/simplify?points=10&wait=60", as_ply(sphere(100)))
                  .status,
              200);
    request(server.admin_port(), "GET", "/metrics");
    const std::string metrics = request(server.admin_port(), "GET", "/metrics").body;
    EXPECT_NE(metrics.find("stipple_jobs_ended_total{status=\"successful\"} 1\n"),
              std::string::npos)
        << metrics;
    EXPECT_NE(metrics.find("stipple_http_requests_total{"), std::string::npos) << metrics;
    EXPECT_NE(metrics.find("route=\"/v1/limits\""), std::string::npos) << metrics;
    EXPECT_EQ(request(server.port(), "GET", "/metrics").status, 404);
}

TEST(Stippled, KeepsTenantsApart) {
    const TemporaryFolder folder;
    const auto entry = [](const char* tenant, const char* key, Json scopes) {
        return Json{
            {"tenant", tenant}, {"key_sha256", hash_of(key)}, {"scopes", std::move(scopes)}};
    };
    std::ofstream(folder / "keys.json")
        << Json{entry("a", "key-a", {"admin"}), entry("b", "key-b", {"admin"}),
                entry("a", "look-a", {"read"})};
    const StippledProcess server({"--api-keys", (folder / "keys.json").string()});
    const auto with = [](const char* key) {
        return std::vector<std::string>{std::string("Authorization: Bearer ") + key};
    };

    const std::string bytes = as_ply(sphere(100));
    const HttpReply anonymous = request(server.port(), "POST", "/v1/clouds", bytes);
    EXPECT_EQ(problem_of(anonymous), "unauthorized");
    EXPECT_EQ(anonymous.field("WWW-Authenticate"), "Bearer");
    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/clouds", bytes, with("wrong"))),
              "unauthorized");
    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/clouds", bytes, with("look-a"))),
              "forbidden");
    ASSERT_EQ(request(server.port(), "POST", "/v1/clouds", bytes, with("key-a")).status, 201);

    const std::string target = "/v1/clouds/" + hash_of(bytes);
    EXPECT_EQ(request(server.port(), "GET", target, {}, with("look-a")).status, 200);
    EXPECT_EQ(problem_of(request(server.port(), "GET", target, {}, with("key-b"))), "not-found");
    EXPECT_EQ(problem_of(request(server.port(), "DELETE", target, {}, with("key-b"))), "not-found");
    EXPECT_EQ(request(server.port(), "GET", "/v1/limits").status, 200);
}

TEST(Stippled, EndsInOrderOnSigterm) {
    StippledProcess server;
    RawConnection idle(server.port());
    EXPECT_EQ(server.stop(), 0);
    EXPECT_TRUE(idle.closed_within(10s));
}

}  // namespace
}  // namespace stipple::test
