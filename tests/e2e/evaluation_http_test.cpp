// The real stippled asked how far clouds are apart.
#include "served_jobs.hpp"

#include <gtest/gtest.h>

namespace stipple::test {
namespace {

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

TEST(Stippled, SaysOfADismissedEvaluationThatItIsNotToBeWaitedFor) {
    const StippledProcess server({"--role", "api"});
    const std::string id = upload(server, as_ply(sphere(100)));
    const std::string body = Json{{"reference", id}, {"candidate", id}}.dump();
    const std::vector<std::string> keyed = {kJson[0], "Idempotency-Key: mine"};
    const auto evaluate = [&] {
        return request(server.port(), "POST", "/v1/evaluations?wait=0", body, keyed);
    };
    const HttpReply queued = evaluate();
    ASSERT_EQ(queued.status, 201);
    ASSERT_EQ(request(server.port(), "DELETE", queued.field("Location")).status, 200);
    EXPECT_EQ(problem_of(evaluate()), "conflict");
}

}  // namespace
}  // namespace stipple::test
