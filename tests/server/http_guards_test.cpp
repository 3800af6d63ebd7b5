#include "http/api_keys.hpp"
#include "http/conditional.hpp"
#include "http/framed_body.hpp"
#include "http/permits.hpp"
#include "http/request_head.hpp"

#include "support/support.hpp"

#include "stipple/proto/digest.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <fstream>
#include <string>

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

TEST(RequestHead, RefusesControlCharactersInAnyDisguise) {
    EXPECT_EQ(refusal_of(std::string("X-A: a\0b", 8)), 400);
    EXPECT_EQ(refusal_of("X-A: a\nb"), 400);
    EXPECT_EQ(refusal_of("X-A: a\rb"), 400);
    EXPECT_EQ(refusal_of("X-A: a%0Ab"), 400);
    EXPECT_EQ(refusal_of("X-A: a%0db"), 400);
    EXPECT_EQ(refusal_of("X-A: a%20b 100%"), 200);
}

TEST(RequestHead, RefusesFieldsThatAreNone) {
    EXPECT_EQ(refusal_of("no colon"), 400);
    EXPECT_EQ(refusal_of(" Folded: line"), 400);
    EXPECT_EQ(refusal_of("Space : before colon"), 400);
    EXPECT_EQ(refusal_of("Host: second"), 400);
}

TEST(RequestHead, RefusesWhatNoRouteTakes) {
    EXPECT_EQ(refusal_of("Content-Encoding: gzip"), 415);
    EXPECT_EQ(refusal_of("Content-Type: multipart/form-data; boundary=x"), 415);
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

TEST(Permits, AreRefusedAboveTheirNumberAndComeBack) {
    Permits permits("tests", 1);
    auto first = permits.take();
    EXPECT_EQ(status_of([&] { permits.take(); }), 503);
    first.reset();
    EXPECT_NE(permits.take(), nullptr);
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

TEST(ApiKeys, AreRefusedWhenTheFileIsWrong) {
    EXPECT_THROW(keys_of("[]"), Error);
    EXPECT_THROW(keys_of("{"), Error);
    EXPECT_THROW(keys_of(R"([{"tenant": "lab", "key_sha256": "short", "scopes": ["read"]}])"),
                 Error);
}

}  // namespace
}  // namespace stipple::server::http
