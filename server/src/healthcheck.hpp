#pragma once

#include "config.hpp"

namespace stipple::server {

/// Asks `/readyz` of a running service. @returns the exit status: 0 when it is ready.
int healthcheck(const ServerConfig& config);

}  // namespace stipple::server
