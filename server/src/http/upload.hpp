#pragma once

#include "http/routes.hpp"

namespace stipple::server::http {

/// Streams the body of a request into a cloud. Nothing is left of one that breaks off.
/// @param name  as `Service::finish_upload` takes it. @throws HttpError 411, 413; as `check_head`.
Submission<proto::CloudDocument> receive_cloud(Resources& resources, Request& request,
                                               const std::optional<std::string>& name);

}  // namespace stipple::server::http
