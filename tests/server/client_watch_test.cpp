#include "http/client_watch.hpp"

#include <gtest/gtest.h>
#include <atomic>
#include <thread>

namespace stipple::server::http {
namespace {

using namespace std::chrono_literals;

bool stops(const std::stop_token& token) {
    for (int tries = 0; tries < 1000 && !token.stop_requested(); ++tries)
        std::this_thread::sleep_for(5ms);
    return token.stop_requested();
}

TEST(ClientWatch, StopsWhatIsComputedWhenTheClientLeaves) {
    std::atomic<bool> gone = false;
    Request request;
    request.client_gone = [&] { return gone.load(); };
    const ClientWatch watch(request, 60s);
    EXPECT_FALSE(watch.left().stop_requested());
    gone = true;
    EXPECT_TRUE(stops(watch.left()));
}

TEST(ClientWatch, StopsWhatTakesTooLong) {
    Request request;
    request.client_gone = [] { return false; };
    const ClientWatch watch(request, 0s);
    EXPECT_TRUE(stops(watch.left()));
    EXPECT_TRUE(watch.is_late());
}

TEST(ClientWatch, EndsWithItsClientStillThere) {
    Request request;
    request.client_gone = [] { return false; };
    std::stop_token left;
    {
        const ClientWatch watch(request, 60s);
        left = watch.left();
    }
    EXPECT_FALSE(left.stop_requested());
}

}  // namespace
}  // namespace stipple::server::http
