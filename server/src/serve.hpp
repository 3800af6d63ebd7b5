#pragma once

#include "config.hpp"

namespace stipple::server {

/// Runs the service until SIGTERM, SIGINT or SIGHUP, then lets it end in order; one of the first
/// two that comes more than a second later ends it at once.
/// @returns the exit status. @throws Error when it cannot start.
int serve(const ServerConfig& config);

}  // namespace stipple::server
