#pragma once

#include "http/connection.hpp"
#include "store/job_store.hpp"

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace stipple::server::http {

/// What the service counts, for Prometheus. Safe to use from any thread.
class Metrics {
public:
    Metrics();
    ~Metrics();

    void request_answered(std::string_view method, std::string_view route, int status);
    void request_served(std::string_view route, const Served& outcome);
    void request_refused(std::string_view reason);
    void attempt_ended(std::string_view outcome);
    /// Where jobs run: these are told from the start, as alerts need them.
    void expect_attempts(std::span<const std::string_view> outcomes);

    /// The text exposition; the queue and the connections as they are now.
    std::string text(const JobStore::Counts& queue, unsigned connections);

private:
    struct Series;
    std::unique_ptr<Series> series_;
};

}  // namespace stipple::server::http
