// Jobs of the real stippled over HTTP: submitted, followed, cancelled.
#include "served_jobs.hpp"

#include <gtest/gtest.h>

namespace stipple::test {
namespace {

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

TEST(Stippled, SaysWhyNoMoreLevelsComeOfAJobThatWasDismissedOrFailed) {
    const StippledProcess server;
    const std::string failed = submit(server, pyramid_of(upload(server, kNoPoint)));
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

}  // namespace
}  // namespace stipple::test
