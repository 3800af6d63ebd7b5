#pragma once

#include "store/sqlite.hpp"

namespace stipple::server::sqlite {

/// The schema of a database; 0: it is new. @throws Error(InvalidArgument) when it is another
/// program's, Error(Internal) when a newer version of this one wrote it.
std::size_t check_schema(Connection& connection);

/// Brings a database to the present schema, all steps or none. @throws as `check_schema`.
void migrate(Connection& connection);

}  // namespace stipple::server::sqlite
