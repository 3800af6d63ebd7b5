#pragma once

#include "http/routes.hpp"

namespace stipple::server::http {

/// Streams the body of a request into a cloud. Nothing is left of one that breaks off. @throws
/// HttpError 411, 413, 415.
proto::CloudDocument receive_cloud(Resources& resources, Request& request, bool& existed);

}  // namespace stipple::server::http
