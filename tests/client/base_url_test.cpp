#include "base_url.hpp"

#include "stipple/error.hpp"

#include <gtest/gtest.h>

namespace stipple {
namespace {

std::string refusal(std::string_view text) {
    try {
        parse_base_url(text);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::InvalidArgument);
        return error.what();
    }
    return "accepted";
}

TEST(BaseUrl, IsSchemeHostAndPort) {
    const BaseUrl url = parse_base_url("http://scans.example.org:8080");
    EXPECT_EQ(url.scheme, "http");
    EXPECT_EQ(url.host, "scans.example.org");
    EXPECT_EQ(url.port, 8080);
}

TEST(BaseUrl, TakesThePortOfItsSchemeWhenItNamesNone) {
    EXPECT_EQ(parse_base_url("http://localhost").port, 80);
    EXPECT_EQ(parse_base_url("https://localhost").port, 443);
}

TEST(BaseUrl, MayEndWithOneSlash) {
    EXPECT_EQ(parse_base_url("http://localhost:8080/").text(), "http://localhost:8080");
}

TEST(BaseUrl, MayHaveAPathUnderWhichAProxyOffersTheServer) {
    const BaseUrl url = parse_base_url("https://example.org:8443/scans/lab/");
    EXPECT_EQ(url.text(), "https://example.org:8443/scans/lab");
    EXPECT_EQ(url.origin(), "https://example.org:8443");
    EXPECT_EQ(url.on_host("/v1/jobs"), "/scans/lab/v1/jobs");
    EXPECT_EQ(url.on_host("/scans/lab/v1/jobs"), "/scans/lab/v1/jobs");  // a link in a reply
    EXPECT_EQ(parse_base_url("http://a").on_host("/v1/jobs"), "/v1/jobs");
}

TEST(BaseUrl, KnowsIpv6AddressesInBrackets) {
    const BaseUrl url = parse_base_url("http://[::1]:8080");
    EXPECT_EQ(url.host, "[::1]");
    EXPECT_EQ(url.port, 8080);
    EXPECT_EQ(url.text(), "http://[::1]:8080");
}

TEST(BaseUrl, LeavesTheUsualPortOutOfItsText) {
    EXPECT_EQ(parse_base_url("https://example.org:443").text(), "https://example.org");
}

TEST(BaseUrl, RefusesEveryOtherFormAndSaysWhy) {
    EXPECT_NE(refusal("localhost:8080").find("no scheme"), std::string::npos);
    EXPECT_NE(refusal("ftp://localhost").find("'ftp'"), std::string::npos);
    EXPECT_NE(refusal("http://").find("no host"), std::string::npos);
    EXPECT_NE(refusal("http://:80").find("no host"), std::string::npos);
    EXPECT_NE(refusal("http://a:0").find("1..65535"), std::string::npos);
    EXPECT_NE(refusal("http://a:65536").find("1..65535"), std::string::npos);
    EXPECT_NE(refusal("http://a:").find("1..65535"), std::string::npos);
    EXPECT_NE(refusal("http://a:8x").find("1..65535"), std::string::npos);
    EXPECT_NE(refusal("http://a/v1?x").find("query"), std::string::npos);
    EXPECT_NE(refusal("http://a/v 1").find("letters"), std::string::npos);
    EXPECT_NE(refusal("http://a//").find("empty"), std::string::npos);
    EXPECT_NE(refusal("http://a//b").find("//b"), std::string::npos);
    EXPECT_NE(refusal("http://user:secret@a").find("password"), std::string::npos);
    EXPECT_NE(refusal("http://[::1").find("']'"), std::string::npos);
    EXPECT_NE(refusal("http://a\r\nX: y").find("character"), std::string::npos);
}

}  // namespace
}  // namespace stipple
