#pragma once

#include "http/api_keys.hpp"
#include "http/message.hpp"
#include "http/permits.hpp"
#include "service/service.hpp"

#include <chrono>
#include <span>
#include <string_view>

namespace stipple::server::http {

/// What the service itself computes, so many at a time: slices, and documents of pyramids that are
/// not in its memory. Others wait for a place.
inline constexpr unsigned kMostSlices = 4, kMostDocuments = 4;
inline constexpr std::chrono::seconds kLongestWaitForPlace{10}, kLongestSlice{30};

/// What the handlers work with.
struct Resources {
    Service& service;
    bool with_keys = false;  ///< replies are for their tenant alone
    Permits uploads, downloads, waits, streams, slices, documents;

    Resources(Service& the_service, bool keys, const Senders& senders)
        : service(the_service),
          with_keys(keys),
          uploads("uploads", places_among(senders, senders.connections / 8 + 1)),
          downloads("downloads", places_among(senders, senders.connections / 4 + 1)),
          waits("long polls", places_among(senders, senders.connections / 4 + 1)),
          streams("event streams", places_among(senders, senders.connections / 4 + 1)),
          slices("slices of pyramids", places_among(senders, kMostSlices), kLongestWaitForPlace),
          documents("documents of pyramids", places_among(senders, kMostDocuments),
                    kLongestWaitForPlace) {}
};

/// Whether scripts of other sites may read the reply: those that the server was told of, or all.
enum class Sharing { Listed, Everyone };

struct Route {
    std::string_view method;
    std::string_view path;  ///< `{name}` stands for one segment, or its begin
    Scope scope;
    Sharing sharing;
    Reply (*handle)(Resources&, Request&);
};

/// One line for each operation, in the order of openapi.yaml.
std::span<const Route> routes() noexcept;

/// What a method and a path lead to.
struct RouteMatch {
    const Route* route = nullptr;      ///< null: none of this method
    const Route* same_path = nullptr;  ///< one of another method, when there is one
    std::string allow;                 ///< the methods of the path, as in `Allow`
    std::map<std::string, std::string, std::less<>> values;
};
RouteMatch find_route(std::string_view method, std::string_view path);

// Handlers, by resource: clouds.cpp, jobs.cpp, simplify.cpp, pyramids.cpp, limits.cpp, pages.cpp.
Reply upload_cloud(Resources&, Request&);
Reply list_clouds(Resources&, Request&);
Reply get_cloud(Resources&, Request&);
Reply remove_cloud(Resources&, Request&);
Reply get_cloud_content(Resources&, Request&);
Reply submit_job(Resources&, Request&);
Reply list_jobs(Resources&, Request&);
Reply get_job(Resources&, Request&);
Reply dismiss_job(Resources&, Request&);
Reply follow_job(Resources&, Request&);
Reply get_results(Resources&, Request&);
Reply get_result_file(Resources&, Request&);
Reply simplify(Resources&, Request&);
Reply evaluate(Resources&, Request&);
Reply get_manifest(Resources&, Request&);
Reply get_tileset(Resources&, Request&);
Reply get_stream(Resources&, Request&);
Reply get_slice(Resources&, Request&);
Reply get_pyramid_archive(Resources&, Request&);
Reply get_pyramid_file(Resources&, Request&);
Reply get_limits(Resources&, Request&);
Reply get_openapi(Resources&, Request&);
Reply get_docs(Resources&, Request&);
Reply get_docs_style(Resources&, Request&);
Reply get_viewer(Resources&, Request&);
Reply get_viewer_file(Resources&, Request&);

}  // namespace stipple::server::http
