#pragma once

#include <string_view>

namespace stipple::proto {

/// What a client calls a request by, so that repeating it does no harm: 1 to 255 printable ASCII
/// characters, since it travels as a header field.
/// @throws Error(InvalidArgument) for any other.
void check_idempotency_key(std::string_view key);

}  // namespace stipple::proto
