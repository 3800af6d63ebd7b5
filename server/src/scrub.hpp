#pragma once

#include "config.hpp"

namespace stipple::server {

/// Reads every stored file of a stopped server and compares it with its hash; tells of each that is
/// not what it was, and of each that the database names and that is not there. Changes nothing.
/// @returns the exit status: 0 when all are there and whole.
int scrub(const ServerConfig& config);

}  // namespace stipple::server
