#pragma once

#include "http/metrics.hpp"
#include "http/routes.hpp"

#include <memory>
#include <string>
#include <vector>

namespace stipple::server::http {

struct ApiOptions {
    /// None: everyone may do everything, as the tenant `default`.
    std::shared_ptr<ApiKeyFile> keys{};
    std::vector<std::string>
        cors_origins;    ///< whose scripts may use the API: `https://example.org`, or `*`
    bool local = false;  ///< for this machine alone: domains in `Host` must be among the next
    std::vector<std::string> host_names;
    unsigned max_connections = 512;
    unsigned max_connections_per_address = 128;
};

/// The API: what all routes have in common (request ids, keys, tenants, CORS, problems, the access
/// log), and the routes.
class Api : public Application {
public:
    Api(ApiOptions options, Service& service, Metrics& metrics);

    Reply handle(Request& request) override;
    void answered(const Request& request, int status) override;
    void served(const Request& request, const Served& outcome) override;
    void refused(std::string_view id, std::string_view address, int status,
                 std::string_view detail) override;

private:
    Reply answer(Request& request);
    void take_prefix(Request& request) const;
    void authorize(const Route& route, Request& request) const;
    void refuse_foreign_names(const Request& request) const;
    void refuse_foreign_sites(const Route& route, const Request& request) const;
    void share(const Route& route, const Request& request, Reply& reply) const;
    Reply preflight(const RouteMatch& match, const Request& request) const;
    bool listed(std::string_view origin) const noexcept;

    const ApiOptions options_;
    Resources resources_;
    Metrics& metrics_;
};

/// The reply for a failure under way: a problem, of which only what the caller can use is told.
Reply failure_reply(std::exception_ptr failure, const Request& request);

}  // namespace stipple::server::http
