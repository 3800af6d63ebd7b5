#include "http/api_keys.hpp"
#include "http/conditional.hpp"
#include "http/framed_body.hpp"
#include "http/guarded_server.hpp"
#include "http/permits.hpp"
#include "http/request_head.hpp"

#include "support/support.hpp"

#include "stipple/proto/digest.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <algorithm>
#include <fstream>
#include <string>
#include <thread>

namespace stipple::server::http {
namespace {

RequestHead head_of(const std::string& fields,
                    const std::string& line = "POST /v1/clouds HTTP/1.1") {
    return parse_head(line + "\r\nHost: h" + (fields.empty() ? "" : "\r\n" + fields));
}

int status_of(const std::function<void()>& action) {
    try {
        action();
    } catch (const HttpError& error) {
        return error.problem.status;
    }
    return 200;
}

int refusal_of(const std::string& fields, const std::string& line = "POST /v1/clouds HTTP/1.1") {
    return status_of([&] { head_of(fields, line); });
}

TEST(RequestHead, ReadsTheRequestLineAndTheFields) {
    const RequestHead head =
        head_of("Content-Length: 12\r\nX-Request-Id:  a b \t", "POST /v1/x?y=1 HTTP/1.1");
    EXPECT_EQ(head.method, "POST");
    EXPECT_EQ(head.target, "/v1/x?y=1");
    EXPECT_EQ(head.content_length, 12U);
    EXPECT_EQ(head.headers.find("x-request-id"), "a b");
}

TEST(RequestHead, RefusesABodyWhoseLengthCanBeReadInTwoWays) {
    EXPECT_EQ(refusal_of("Content-Length: 5\r\nTransfer-Encoding: chunked"), 400);
    EXPECT_EQ(refusal_of("Content-Length: 5\r\nContent-Length: 5"), 400);
    EXPECT_EQ(refusal_of("Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked"), 501);
    EXPECT_EQ(refusal_of("Transfer-Encoding: gzip, chunked"), 501);
    for (const char* length :
         {"-1", "+5", "5 5", "5, 5", "0x5", "", "99999999999999999999", "18446744073709551615"}) {
        EXPECT_EQ(refusal_of(std::string("Content-Length: ") + length), 400) << length;
    }
}

TEST(RequestHead, RefusalsRepeatWhatWasSentButNoLineThatMayHoldAKey) {
    const auto text_of = [](const std::string& fields, const std::string& line) {
        try {
            head_of(fields, line);
        } catch (const HttpError& error) {
            return error.problem.detail;
        }
        return std::string("accepted");
    };
    const std::string post = "POST /v1/clouds HTTP/1.1", key = "Authorization: Bearer abcdef";
    EXPECT_NE(text_of("Content-Length: 1k", post).find("`1k`"), std::string::npos);
    EXPECT_NE(text_of("Expect: 200-ok", post).find("`200-ok`"), std::string::npos);
    EXPECT_NE(text_of("", "PURGE / HTTP/1.1").find("`PURGE`"), std::string::npos);
    EXPECT_NE(text_of("", "GET / HTTP/2.0").find("`HTTP/2.0`"), std::string::npos);
    EXPECT_EQ(text_of("Expect: " + std::string(90, 'x'), post).find(std::string(41, 'x')),
              std::string::npos);
    EXPECT_EQ(text_of("", key).find("abcdef"), std::string::npos);
    EXPECT_EQ(text_of("Authorization Bearer abcdef", post).find("abcdef"), std::string::npos);
}

TEST(RequestHead, RefusesControlCharactersButNotTheirCodesWhichNobodyDecodes) {
    EXPECT_EQ(refusal_of(std::string("X-A: a\0b", 8)), 400);
    EXPECT_EQ(refusal_of("X-A: a\nb"), 400);
    EXPECT_EQ(refusal_of("X-A: a\rb"), 400);
    EXPECT_EQ(refusal_of("Cookie: note=line%0Aline; tab=a%09b"), 200);
    EXPECT_EQ(refusal_of("X-A: a%20b 100%"), 200);
}

TEST(RequestHead, RefusesFieldsThatAreNone) {
    EXPECT_EQ(refusal_of("no colon"), 400);
    EXPECT_EQ(refusal_of(" Folded: line"), 400);
    EXPECT_EQ(refusal_of("Space : before colon"), 400);
    EXPECT_EQ(refusal_of("Host: second"), 400);
}

TEST(RequestHead, RefusesWhatNoRouteTakes) {
    EXPECT_EQ(refusal_of("Expect: the worst"), 417);
    EXPECT_EQ(refusal_of("Content-Length: 3", "GET / HTTP/1.1"), 400);
    EXPECT_EQ(refusal_of("Content-Length: 0", "DELETE /x HTTP/1.1"), 200);
}

TEST(RequestHead, RefusesRequestLinesThatAreNone) {
    EXPECT_EQ(refusal_of("", "GET /"), 400);
    EXPECT_EQ(refusal_of("", "GET / HTTP/2.0"), 505);
    EXPECT_EQ(refusal_of("", "BREW / HTTP/1.1"), 501);
    EXPECT_EQ(refusal_of("", "GET relative HTTP/1.1"), 400);
    EXPECT_EQ(refusal_of("", "GET /a b HTTP/1.1"), 400);
    EXPECT_EQ(refusal_of("", "GET /" + std::string(kMaxTargetBytes, 'a') + " HTTP/1.1"), 414);
    EXPECT_EQ(refusal_of("", "GET /" + std::string(kMaxTargetBytes - 1, 'a') + " HTTP/1.1"), 200);
}

TEST(RequestHead, TakesAsManyFieldsAsAreAllowedAndNoMore) {
    std::string fields = "A: 1";
    for (std::size_t i = 2; i < kMaxHeaderFields; ++i) fields += "\r\nA: 1";
    EXPECT_EQ(refusal_of(fields), 200);  // and Host
    EXPECT_EQ(refusal_of(fields + "\r\nA: 1"), 431);
}

/// The bytes of a connection, three at a time.
class Script {
public:
    explicit Script(std::string bytes) : bytes_(std::move(bytes)) {}
    ByteSource source() {
        return [this](std::span<std::byte> out) {
            if (used_ == bytes_.size()) throw Disconnected();
            const std::size_t n = std::min({out.size(), bytes_.size() - used_, std::size_t{3}});
            std::copy_n(reinterpret_cast<const std::byte*>(bytes_.data()) + used_, n, out.begin());
            used_ += n;
            return n;
        };
    }
    std::string rest() const { return bytes_.substr(used_); }

private:
    const std::string bytes_;
    std::size_t used_ = 0;
};

int chunked_refusal(const std::string& bytes) {
    Script script(bytes);
    FramedBody body(head_of("Transfer-Encoding: chunked"), script.source(), {});
    return status_of([&] { read_all(body, 1000); });
}

TEST(FramedBody, JoinsChunksAndLeavesTheNextRequest) {
    Script script("5;note=x\r\nhello\r\n6\r\n world\r\n0\r\nTrailer: y\r\n\r\nGET /");
    FramedBody body(head_of("Transfer-Encoding: chunked"), script.source(), {});
    EXPECT_EQ(read_all(body, 1000), "hello world");
    EXPECT_TRUE(body.finished());
    EXPECT_EQ(script.rest(), "GET /");
}

TEST(FramedBody, RefusesChunkSizesThatAreNone) {
    for (const char* size :
         {"-1", "+5", "0x5", " 5", "5 ", "", "g", "ffffffffffffffff", "10000000000000000"}) {
        EXPECT_EQ(chunked_refusal(std::string(size) + "\r\nhello\r\n0\r\n\r\n"), 400) << size;
    }
    EXPECT_EQ(chunked_refusal("5\r\nhello!\r\n0\r\n\r\n"), 400);
    EXPECT_EQ(chunked_refusal("5;" + std::string(300, 'x') + "\r\nhello\r\n0\r\n\r\n"), 400);
    EXPECT_EQ(chunked_refusal("0\r\n" + std::string(5000, 'x') + "\r\n\r\n"), 400);
}

TEST(FramedBody, TellsAWaitingClientToGoOnOnceItIsRead) {
    Script script("hello");
    int told = 0;
    FramedBody body(head_of("Content-Length: 5"), script.source(), [&told] { ++told; });
    EXPECT_EQ(told, 0);
    EXPECT_EQ(read_all(body, 5), "hello");
    EXPECT_EQ(told, 1);
}

TEST(FramedBody, RefusesMoreThanTheReaderTakes) {
    Script script("hello");
    FramedBody body(head_of("Content-Length: 5"), script.source(), {});
    EXPECT_EQ(status_of([&] { read_all(body, 4); }), 413);
    EXPECT_FALSE(FramedBody(head_of("Content-Length: 5"), script.source(), {}).finished());
}

TEST(ByteRange, TakesOneRangeAndCutsItToTheBytesThereAre) {
    const auto text = [](const char* field) {
        const auto range = parse_range(field, 100);
        return range ? std::to_string(range->offset) + "+" + std::to_string(range->length)
                     : "ignored";
    };
    EXPECT_EQ(text("bytes=0-9"), "0+10");
    EXPECT_EQ(text("bytes=90-"), "90+10");
    EXPECT_EQ(text("bytes=90-1000"), "90+10");
    EXPECT_EQ(text("bytes=-10"), "90+10");
    EXPECT_EQ(text("bytes=-1000"), "0+100");
    for (const char* field : {"bytes=0-1,3-4", "bytes=9-3", "bytes=a-b", "bytes=-", "lines=0-1",
                              "bytes=", "bytes=+1-2"}) {
        EXPECT_EQ(text(field), "ignored") << field;
    }
    EXPECT_EQ(status_of([] { parse_range("bytes=100-", 100); }), 416);
    EXPECT_EQ(status_of([] { parse_range("bytes=-0", 100); }), 416);
}

TEST(IfNoneMatch, FindsATagInAList) {
    EXPECT_TRUE(none_match_names(R"("a", W/"b")", R"("b")"));
    EXPECT_TRUE(none_match_names("*", R"("b")"));
    EXPECT_FALSE(none_match_names(R"("a", "c")", R"("b")"));
}

TEST(IfNoneMatch, MayStandOnSeveralLines) {
    Request request;
    request.headers.add("If-None-Match", R"("a")");
    request.headers.add("If-None-Match", R"("b")");
    EXPECT_EQ(request.headers.joined("if-none-match"), R"("a", "b")");
    EXPECT_FALSE(request.headers.joined("Accept"));
    EXPECT_EQ(tagged_reply(request, "b", "no-cache", {}).status, 304);
    EXPECT_EQ(tagged_reply(request, "c", "no-cache", {}).status, 200);
}

TEST(RequestId, OfAHeadThatIsRefusedIsKnown) {
    EXPECT_EQ(given_id("GET / HTTP/9\r\nHost\r\nx-request-id: \tmine "), "mine");
    EXPECT_EQ(given_id("X-Request-Id"), "");
    EXPECT_EQ(request_id("a.b-c_9"), "a.b-c_9");
    for (const std::string unfit : {"", "a b", "a\nb"}) EXPECT_NE(request_id(unfit), unfit);
    EXPECT_EQ(request_id(std::string(65, 'a')).size(), 16U);
}

TEST(ListItem, HasItsQualityAmongOtherParameters) {
    EXPECT_EQ(list_item(" model/ply ; version=1 ; Q=0.1").name, "model/ply");
    EXPECT_EQ(list_item("model/ply;version=1;q=0.1").quality, 0.1);
    EXPECT_EQ(list_item("gzip;q=0").quality, 0);
    EXPECT_EQ(list_item("gzip;version=1").quality, 1);
    EXPECT_EQ(list_item("gzip;q=many").quality, 0);
}

Request from(const char* address, const char* tenant = "default") {
    Request request;
    request.remote_address = address;
    request.tenant = tenant;
    request.tenants = 2;
    return request;
}

/// Why there is no place for the request.
std::string refusal_by(Permits& permits, const Request& request) {
    try {
        permits.take(request);
    } catch (const HttpError& error) {
        EXPECT_EQ(error.problem.status, 503);
        EXPECT_TRUE(error.problem.retry_after);
        return error.problem.detail;
    }
    return "none";
}

TEST(Permits, AreRefusedAboveTheirNumberAndComeBack) {
    Permits permits("tests", {.all = 1});
    auto first = permits.take(from("a"));
    EXPECT_EQ(status_of([&] { permits.take(from("a")); }), 503);
    EXPECT_EQ(refusal_by(permits, from("b")), "all 1 places for tests are taken: try again later");
    first.reset();
    EXPECT_NE(permits.take(from("a")), nullptr);
}

TEST(Permits, LeaveOthersTheirsWhateverOneSenderDoes) {
    Permits permits("tests", {.all = 4, .of_address = 2, .of_tenant = 3});
    auto first = permits.take(from("a", "x"));
    const auto second = permits.take(from("a", "x"));
    EXPECT_EQ(refusal_by(permits, from("a", "y")),
              "your address has 2 of the 4 places for tests, its limit: try again later");
    const auto third = permits.take(from("b", "x"));
    EXPECT_EQ(refusal_by(permits, from("c", "x")),
              "tenant x has 3 of the 4 places for tests, its limit: try again later");
    EXPECT_NE(permits.take(from("c", "y")), nullptr);
    Request only = from("c", "x");
    only.tenants = 1;
    EXPECT_NE(permits.take(only), nullptr) << "there is nobody to leave places to";
    first.reset();
    EXPECT_NE(permits.take(from("a", "x")), nullptr);
}

TEST(Permits, AreWaitedForAMoment) {
    Permits permits("tests", {.all = 1});
    auto first = permits.take(from("a"));
    const std::jthread soon([&first] { first.reset(); });
    EXPECT_NE(permits.take(from("a")), nullptr);
}

TEST(PlacesAmong, GivesAnAddressItsPartAndATenantAQuarter) {
    const Places usual = places_among({.connections = 512, .of_address = 128}, 65);
    EXPECT_EQ(usual.all, 65U);
    EXPECT_EQ(usual.of_address, 17U);
    EXPECT_EQ(usual.of_tenant, 17U);
    const Places behind_proxy = places_among({.connections = 512, .of_address = 512}, 65);
    EXPECT_EQ(behind_proxy.of_address, 65U);
    EXPECT_EQ(places_among({.connections = 16, .of_address = 128}, 5).of_address, 5U);
    EXPECT_EQ(places_among({}, 4).of_address, 2U);
    EXPECT_EQ(places_among({.connections = 8, .of_address = 1}, 1).of_address, 1U);
}

std::string sender(const char* address) {
    sockaddr_storage storage{};
    if (std::string_view(address).find(':') == std::string_view::npos) {
        storage.ss_family = AF_INET;
        ::inet_pton(AF_INET, address, &reinterpret_cast<sockaddr_in&>(storage).sin_addr);
    } else {
        storage.ss_family = AF_INET6;
        ::inet_pton(AF_INET6, address, &reinterpret_cast<sockaddr_in6&>(storage).sin6_addr);
    }
    return sender_of(storage);
}

TEST(Sender, IsAnAddressOrTheNetworkThatOneOwnerHas) {
    EXPECT_EQ(sender("192.0.2.7"), "192.0.2.7");
    EXPECT_EQ(sender("::ffff:192.0.2.7"), "192.0.2.7");
    EXPECT_EQ(sender("2001:db8:1:2:3:4:5:6"), "2001:db8:1:2::/64");
    EXPECT_EQ(sender("2001:db8:1:2:9::1"), sender("2001:db8:1:2::1"));
    EXPECT_NE(sender("2001:db8:1:3::1"), sender("2001:db8:1:2::1"));
}

ApiKeys keys_of(const std::string& json) {
    const test::TemporaryFolder folder;
    std::ofstream(folder / "keys.json") << json;
    return ApiKeys::read(folder / "keys.json");
}

TEST(ApiKeys, AreKnownByTheirHashWithTheirScopes) {
    const std::string key = "s3cret";
    const std::string hash = proto::sha256_hex(std::as_bytes(std::span(key)));
    const ApiKeys keys =
        keys_of(R"([{"tenant": "lab", "key_sha256": ")" + hash + R"(", "scopes": ["read"]}])");
    const auto grant = keys.find(key);
    ASSERT_TRUE(grant);
    EXPECT_EQ(grant->tenant, "lab");
    EXPECT_TRUE(grant->allows(Scope::Read));
    EXPECT_FALSE(grant->allows(Scope::Submit));
    EXPECT_FALSE(keys.find("S3cret"));
    EXPECT_FALSE(keys.find(hash));
}

/// What is said against the file, without its name.
std::string refusal_of_keys(const std::string& json) {
    try {
        keys_of(json);
    } catch (const Error& error) {
        const std::string said = error.what();
        EXPECT_EQ(said.find("--api-keys "), 0U) << said;
        const std::string file = "keys.json: ";
        EXPECT_NE(said.find(file), said.npos) << said;
        return said.substr(std::min(said.size(), said.find(file) + file.size()));
    }
    return "nothing";
}

TEST(ApiKeys, AreRefusedByWhatIsWrongAndWhere) {
    const auto entry = [](const std::string& tenant, const std::string& key, const char* scopes) {
        return R"({"tenant": ")" + tenant + R"(", "key_sha256": ")" +
               proto::sha256_hex(std::as_bytes(std::span(key))) + R"(", "scopes": )" + scopes + "}";
    };
    const std::string lab = entry("lab", "one", R"(["read"])");
    const auto second = [&lab](const std::string& other) {
        return refusal_of_keys("[" + lab + ",\n" + other + "]");
    };
    EXPECT_EQ(second(entry("den", "two", R"(["read"])")), "nothing");
    EXPECT_EQ(second(entry("den", "one", R"(["read"])")),
              "entry 2 (tenant den): key_sha256 is also that of an entry of tenant lab: give each "
              "entry its own key");
    EXPECT_EQ(second(entry("den", "two", "[]")),
              "entry 2 (tenant den): scopes is empty: give read, submit or admin, or remove the "
              "entry");
    EXPECT_EQ(second(entry("den", "", R"(["read"])")),
              "entry 2 (tenant den): key_sha256 is that of an empty key: expected what `printf %s "
              "KEY | sha256sum` prints");
    EXPECT_EQ(second(entry("den", "two", R"(["write"])")),
              R"(entry 2 (tenant den): scope "write": expected "read", "submit" or "admin")");
    EXPECT_EQ(
        second(R"({"tenant": "den", "scopes": ["read"]})"),
        "entry 2 (tenant den): key_sha256 is missing: expected what `printf %s KEY | sha256sum` "
        "prints");
    std::string expiring = entry("den", "two", R"(["read"])");
    expiring.insert(1, R"("expires": "2020-01-01", )");
    EXPECT_EQ(
        second(expiring),
        "entry 2 (tenant den): expires: no such field: expected tenant, key_sha256 and scopes");
    EXPECT_NE(second(entry(R"(a\u001bb)", "two", R"(["read"])"))
                  .find("tenant has control characters: expected a name without"),
              std::string::npos);
    EXPECT_EQ(second("7").find("entry 2: expected {"), 0U);
    EXPECT_EQ(second("oops").find("is not JSON from line 2 on: expected a list"), 0U);
    EXPECT_EQ(refusal_of_keys("{}").find("has no key: expected a list"), 0U);
    EXPECT_EQ(refusal_of_keys("").find("is not JSON"), 0U);
    const test::TemporaryFolder folder;
    for (const char* name : {"", "missing.json"}) {
        try {
            ApiKeys::read(folder / name);
            FAIL() << "read " << folder / name;
        } catch (const Error& error) {
            const std::string expected = *name == 0 ? "is a folder: expected a JSON file"
                                                    : "cannot be read: No such file or directory";
            EXPECT_NE(std::string(error.what()).find(expected), std::string::npos) << error.what();
        }
    }
}

TEST(ApiKeys, AreOfSomeTenants) {
    const auto entry = [](const char* tenant, char digit) {
        return R"({"tenant": ")" + std::string(tenant) + R"(", "key_sha256": ")" +
               std::string(64, digit) + R"(", "scopes": ["read"]})";
    };
    EXPECT_EQ(keys_of("[" + entry("a", '1') + "," + entry("b", '2') + "," + entry("a", '3') + "]")
                  .tenants(),
              2U);
}

TEST(ApiKeyFile, ForgetsAKeyThatIsTakenOutOfTheFile) {
    const test::TemporaryFolder folder;
    const auto write = [&](const std::string& json) {
        std::ofstream(folder / "keys.json") << json;
    };
    const auto entry = [](const std::string& key) {
        return R"({"tenant": "lab", "key_sha256": ")" +
               proto::sha256_hex(std::as_bytes(std::span(key))) + R"(", "scopes": ["read"]})";
    };
    write("[" + entry("old") + "," + entry("leaked") + "]");
    ApiKeyFile file(folder / "keys.json");
    EXPECT_TRUE(file.keys()->find("leaked"));
    write("[" + entry("old") + ", oops");
    EXPECT_TRUE(file.keys()->find("old")) << "a slip locks nobody out";
    write("[" + entry("old") + "]");
    EXPECT_FALSE(file.keys()->find("leaked"));
    EXPECT_TRUE(file.keys()->find("old"));
    // Another key of the same size and time, as copies that keep the times have it.
    const auto written = std::filesystem::last_write_time(folder / "keys.json");
    write("[" + entry("new") + "]");
    std::filesystem::last_write_time(folder / "keys.json", written);
    EXPECT_FALSE(file.keys()->find("old"));
    EXPECT_TRUE(file.keys()->find("new"));
    std::filesystem::remove(folder / "keys.json");
    EXPECT_TRUE(file.keys()->find("new"));
    std::filesystem::create_symlink("keys.json", folder / "keys.json");
    EXPECT_TRUE(file.keys()->find("new")) << "links that go round";
    EXPECT_THROW(ApiKeyFile(folder / "keys.json"), Error);
}

TEST(ApiKeys, AreRefusedWhenTheFileIsWrong) {
    EXPECT_THROW(keys_of("[]"), Error);
    EXPECT_THROW(keys_of("{"), Error);
    EXPECT_THROW(keys_of(R"([{"tenant": "lab", "key_sha256": "short", "scopes": ["read"]}])"),
                 Error);
}

}  // namespace
}  // namespace stipple::server::http
