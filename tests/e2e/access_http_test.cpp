// Who may ask the real stippled: tenants with keys, other sites, other names.
#include "served_jobs.hpp"

#include <gtest/gtest.h>
#include <fstream>

namespace stipple::test {
namespace {

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

/// A proxy that offers the service under a path may pass the path on or leave it out.
TEST(Stippled, IsServedUnderThePathOfAProxy) {
    const StippledProcess server({"--path-prefix", "/scans/lab"});
    const std::string bytes = as_ply(sphere(100));
    const HttpReply uploaded = request(server.port(), "POST", "/scans/lab/v1/clouds", bytes);
    const std::string place = "/scans/lab/v1/clouds/" + hash_of(bytes);
    EXPECT_EQ(uploaded.status, 201);
    EXPECT_EQ(uploaded.field("Location"), place);
    EXPECT_EQ(Json::parse(uploaded.body)["links"][0]["href"], place);
    EXPECT_EQ(request(server.port(), "GET", place).status, 200);
    EXPECT_EQ(request(server.port(), "GET", "/v1/clouds/" + hash_of(bytes)).status, 200);
    EXPECT_EQ(request(server.port(), "GET", "/scans/labs/v1/clouds").status, 404);

    EXPECT_EQ(request(server.port(), "GET", "/scans/lab/openapi.yaml").status, 200);
    const HttpReply page = request(server.port(), "GET", "/scans/lab");
    EXPECT_EQ(page.status, 308);
    EXPECT_EQ(page.field("Location"), "/scans/lab/");
    EXPECT_EQ(request(server.port(), "GET", "/scans/lab?pyramid=1%202").field("Location"),
              "/scans/lab/?pyramid=1%202");

    request(server.port(), "POST", "/v1/clouds", as_ply(sphere(101)));
    EXPECT_TRUE(request(server.port(), "GET", "/v1/clouds?limit=1")
                    .field("Link")
                    .starts_with("</scans/lab/v1/clouds?cursor="));
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
    // A page that sends a form is told what is wrong with it.
    const HttpReply form =
        request(server.port(), "POST", "/v1/clouds", "ply",
                {"Origin: https://app.example", "Content-Type: multipart/form-data; boundary=x"});
    EXPECT_EQ(form.status, 415);
    EXPECT_EQ(form.field("Access-Control-Allow-Origin"), "https://app.example");
}

}  // namespace
}  // namespace stipple::test
