#include "http/routes.hpp"

#include <array>
#include <optional>

namespace stipple::server::http {

namespace {

using enum Scope;
using enum Sharing;

constexpr std::array kRoutes = {
    Route{"POST", "/v1/clouds", Submit, Listed, upload_cloud},
    Route{"GET", "/v1/clouds", Read, Listed, list_clouds},
    Route{"GET", "/v1/clouds/{id}", Read, Listed, get_cloud},
    Route{"DELETE", "/v1/clouds/{id}", Submit, Listed, remove_cloud},
    Route{"GET", "/v1/clouds/{id}/content", Read, Listed, get_cloud_content},
    Route{"POST", "/v1/jobs", Submit, Listed, submit_job},
    Route{"GET", "/v1/jobs", Read, Listed, list_jobs},
    Route{"GET", "/v1/jobs/{id}", Read, Listed, get_job},
    Route{"DELETE", "/v1/jobs/{id}", Submit, Listed, dismiss_job},
    Route{"GET", "/v1/jobs/{id}/events", Read, Listed, follow_job},
    Route{"GET", "/v1/jobs/{id}/results", Read, Listed, get_results},
    Route{"GET", "/v1/jobs/{id}/results/{file}", Read, Everyone, get_result_file},
    Route{"POST", "/v1/simplify", Submit, Listed, simplify},
    Route{"POST", "/v1/evaluations", Submit, Listed, evaluate},
    Route{"GET", "/v1/pyramids/{id}/manifest.json", Read, Everyone, get_manifest},
    Route{"GET", "/v1/pyramids/{id}/tileset.json", Read, Everyone, get_tileset},
    Route{"GET", "/v1/pyramids/{id}/stream", Read, Everyone, get_stream},
    Route{"GET", "/v1/pyramids/{id}/slice", Read, Everyone, get_slice},
    Route{"GET", "/v1/pyramids/{id}.tar", Read, Everyone, get_pyramid_archive},
    Route{"GET", "/v1/pyramids/{id}/{file}", Read, Everyone, get_pyramid_file},
    Route{"GET", "/v1/limits", Open, Everyone, get_limits},
    Route{"GET", "/openapi.yaml", Open, Everyone, get_openapi},
    Route{"GET", "/docs", Open, Listed, get_docs},
    Route{"GET", "/docs.css", Open, Listed, get_docs_style},
    Route{"GET", "/", Open, Listed, get_viewer},
    Route{"GET", "/assets/{file}", Open, Listed, get_viewer_file},
};

/// Takes the next segment off the front, with its slash.
std::string_view take_segment(std::string_view& path) {
    path.remove_prefix(1);
    const std::string_view segment = path.substr(0, path.find('/'));
    path.remove_prefix(segment.size());
    return segment;
}

/// What the placeholders of `pattern` stand for in `path`; nothing when it is another path.
std::optional<std::map<std::string, std::string, std::less<>>> match(std::string_view pattern,
                                                                     std::string_view path) {
    std::map<std::string, std::string, std::less<>> values;
    while (!pattern.empty() && !path.empty()) {
        const std::string_view wanted = take_segment(pattern);
        const std::string_view segment = take_segment(path);
        if (!wanted.starts_with('{')) {
            if (wanted != segment) return std::nullopt;
            continue;
        }
        const auto close = wanted.find('}');
        const std::string_view ending = wanted.substr(close + 1);
        if (segment.size() <= ending.size() || !segment.ends_with(ending)) return std::nullopt;
        values.emplace(wanted.substr(1, close - 1),
                       segment.substr(0, segment.size() - ending.size()));
    }
    if (!pattern.empty() || !path.empty()) return std::nullopt;
    return values;
}

}  // namespace

std::span<const Route> routes() noexcept {
    return kRoutes;
}

RouteMatch find_route(std::string_view method, std::string_view path) {
    RouteMatch found;
    const std::string_view wanted = method == "HEAD" ? "GET" : method;
    std::string_view
        pattern;  // of the first that fits: a literal path stands before its placeholder
    for (const Route& route : kRoutes) {
        if (!pattern.empty() && route.path != pattern) continue;
        auto values = match(route.path, path);
        if (!values) continue;
        pattern = route.path;
        found.same_path = &route;
        found.allow += std::string(route.method) + (route.method == "GET" ? ", HEAD, " : ", ");
        if (route.method == wanted) found.route = &route;
        found.values = std::move(*values);
    }
    if (!found.allow.empty()) found.allow += "OPTIONS";
    return found;
}

}  // namespace stipple::server::http
