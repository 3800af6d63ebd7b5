#pragma once

#include "http/metrics.hpp"
#include "service/service.hpp"

#include <atomic>
#include <functional>

namespace stipple::server::http {

/// The listener for operators: `/livez`, `/readyz`, `/metrics`. It has threads of its own, so that
/// load on the API fails no health check, and asks for no key: keep its address private.
class Admin : public Application {
public:
    Admin(Service& service, Metrics& metrics, std::function<unsigned()> connections);

    /// From now on `/readyz` answers 503: send nothing new here.
    void begin_drain() noexcept { draining_ = true; }

    Reply handle(Request& request) override;
    void answered(const Request&, int) override {}
    void served(const Request&, const Served&) override {}
    void refused(std::string_view, std::string_view, int, std::string_view) override {}

private:
    Reply answer(Request& request);
    Reply ready();

    Service& service_;
    Metrics& metrics_;
    const std::function<unsigned()> connections_;
    std::atomic<bool> draining_ = false;
};

}  // namespace stipple::server::http
