#include "stipple/proto/idempotency_key.hpp"

#include "support/expect_error.hpp"

#include <gtest/gtest.h>
#include <string>

namespace stipple::proto {
namespace {

TEST(IdempotencyKey, IsWhatAHeaderFieldCanHold) {
    for (const std::string& key :
         {std::string("a"), std::string("scan 7/~"), std::string(255, 'k')})
        EXPECT_NO_THROW(check_idempotency_key(key)) << key;
    for (const std::string& key : {std::string(), std::string("a\r\nX: y"), std::string("\x7f"),
                                   std::string("ä"), std::string(256, 'k')})
        test::expect_refused("expected 1..255 printable ASCII characters",
                             [&] { check_idempotency_key(key); });
}

}  // namespace
}  // namespace stipple::proto
