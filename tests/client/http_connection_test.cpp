#include "http_connection.hpp"

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

}  // namespace
}  // namespace stipple
