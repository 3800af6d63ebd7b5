#include "http_connection.hpp"

#include "stipple/error.hpp"

#include <gtest/gtest.h>

namespace stipple {
namespace {

TEST(HttpReply, HasItsFieldsWhateverTheCaseOfTheirNames) {
    const HttpReply reply{200, {}, {}, {}, {{"stipple-points", "5"}, {"X-Empty", ""}}};
    EXPECT_EQ(reply.field("Stipple-Points"), "5");
    EXPECT_EQ(reply.field("x-empty"), "");
    EXPECT_EQ(reply.field("Stipple-Point"), std::nullopt);
    EXPECT_EQ(reply.field("Stipple-Points-"), std::nullopt);
}

TEST(HttpConnection, RefusesAKeyThatWouldBeMoreThanItsHeader) {
    const auto connect = [](const std::string& key) {
        return HttpConnection(parse_base_url("http://127.0.0.1:1"), key, std::chrono::seconds(1),
                              {});
    };
    EXPECT_NO_THROW(connect(""));
    EXPECT_NO_THROW(connect("stpl_A-b.c~1+/="));
    for (const char* const key : {"a\r\nX-Injected: y", "a b", "a\x7f", "\xc3\xa4"})
        EXPECT_THROW(connect(key), Error) << key;
}

TEST(HttpConnection, TellsThatNobodyAnswersFromOtherFailures) {
    const HttpConnection nobody(parse_base_url("http://127.0.0.1:1"), {}, std::chrono::seconds(1),
                                {});
    EXPECT_THROW((void)nobody.get("/v1/limits"), Unreachable);
}

}  // namespace
}  // namespace stipple
