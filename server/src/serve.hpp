#pragma once

#include "config.hpp"

namespace stipple::server {

/// Runs the service until SIGTERM, SIGINT or SIGHUP, then lets it end in order; a second one of the
/// first two ends it at once.
/// @returns the exit status. @throws Error when it cannot start.
int serve(const ServerConfig& config);

/// Asks `/readyz` of a running service. @returns the exit status: 0 when it is ready.
int healthcheck(const ServerConfig& config);

/// Reads every stored file of a stopped server and compares it with its hash; tells of each that is
/// not what it was, and of each that the database names and that is not there. Changes nothing.
/// @returns the exit status: 0 when all are there and whole.
int scrub(const ServerConfig& config);

}  // namespace stipple::server
