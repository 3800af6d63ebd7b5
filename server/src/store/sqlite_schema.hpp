#pragma once

#include "store/sqlite.hpp"

namespace stipple::server::sqlite {

/// Brings a database to the present schema, step by step.
/// @throws Error(Internal) when a newer version of the program wrote it.
void migrate(Connection& connection);

}  // namespace stipple::server::sqlite
