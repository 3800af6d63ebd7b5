#pragma once

#include <string>
#include <string_view>

namespace stipple {

/// Where a server is: `http://HOST[:PORT]`.
struct BaseUrl {
    std::string scheme;  ///< `http` or `https`
    std::string host;    ///< a name or an address; an IPv6 address in brackets
    int port = 80;

    /// Without a path, the default port left out.
    std::string text() const;
};

/// @throws Error(InvalidArgument) saying what is wrong with it.
BaseUrl parse_base_url(std::string_view text);

}  // namespace stipple
