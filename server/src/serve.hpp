#pragma once

#include "config.hpp"

namespace stipple::server {

/// Runs the service until SIGTERM, SIGINT or SIGHUP, then lets it end in order; a second one of the
/// first two ends it at once.
/// @returns the exit status. @throws Error when it cannot start.
int serve(const ServerConfig& config);

}  // namespace stipple::server
