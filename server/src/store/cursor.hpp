#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace stipple::server {

/// Where the next page of a listing starts, as clients carry it: base64url of the listing and a row
/// number.
std::string encode_cursor(std::string_view listing, std::int64_t row);

/// @throws Error(InvalidArgument) for a text that `encode_cursor` did not give for this listing.
std::int64_t decode_cursor(std::string_view listing, std::string_view cursor);

}  // namespace stipple::server
