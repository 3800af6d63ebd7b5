// The real stippled over HTTP: what it says of itself, and why it refuses a request.
#include "served_jobs.hpp"

#include <gtest/gtest.h>
#include <chrono>

namespace stipple::test {
namespace {

using namespace std::chrono_literals;

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

TEST(Stippled, RefusesAPlyFileByItsHeaderBeforeTheRestIsSent) {
    const StippledProcess server({"--max-points", "100000"});
    const auto answer = [&server](std::size_t points, std::size_t length) {
        RawConnection connection(server.port());
        connection.send(
            "POST /v1/clouds HTTP/1.1\r\nHost: h\r\nContent-Length: " + std::to_string(length) +
            "\r\n\r\n" + ascii("element vertex " + std::to_string(points) + "\n" + kXyz, "") +
            std::string(64 << 10, '0'));
        return connection.receive();
    };
    const HttpReply large = answer(100'001, 1'000'000);
    EXPECT_EQ(problem_of(large), "too-large");
    EXPECT_NE(large.body.find("100001 vertices: expected at most 100000"), std::string::npos);
    const HttpReply cut = answer(100'000, 500'000);
    EXPECT_EQ(problem_of(cut), "malformed-input");
    EXPECT_NE(cut.body.find("the file is cut short"), std::string::npos) << cut.body;
    EXPECT_EQ(request(server.port(), "GET", "/v1/clouds").body, "{\"items\":[]}");
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
    EXPECT_EQ(request(server.admin_port(), "POST", "/livez").field("Allow"), "GET, HEAD");
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

TEST(Stippled, EndsInOrderOnSigterm) {
    StippledProcess server;
    RawConnection idle(server.port());
    EXPECT_EQ(server.stop(), 0);
    EXPECT_TRUE(idle.closed_within(10s));
}

}  // namespace
}  // namespace stipple::test
