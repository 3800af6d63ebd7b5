#pragma once

#include "http/message.hpp"

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <thread>

namespace stipple::server::http {

/// Stops what is computed for a reply once nobody can have it any more: when the client closes the
/// connection, when the server cuts it, and when it takes longer than `longest`. For as long as the
/// watch lives, which the request outlives.
class ClientWatch {
public:
    ClientWatch(const Request& request, std::chrono::seconds longest)
        : ends_(std::chrono::steady_clock::now() + longest),
          thread_([this, &request](const std::stop_token& done) {
              std::mutex mutex;
              std::condition_variable_any wake;
              std::unique_lock lock(mutex);
              while (!wake.wait_for(lock, done, kLook, [&] { return done.stop_requested(); })) {
                  if (is_late() || request.client_gone()) left_.request_stop();
              }
          }) {}

    bool is_late() const noexcept { return std::chrono::steady_clock::now() >= ends_; }

    /// For the computation.
    std::stop_token left() const noexcept { return left_.get_token(); }

private:
    static constexpr std::chrono::milliseconds kLook{25};

    const std::chrono::steady_clock::time_point ends_;
    std::stop_source left_;
    std::jthread thread_;
};

}  // namespace stipple::server::http
