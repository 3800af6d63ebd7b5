#pragma once

#include <string>
#include <string_view>

namespace stipple {

/// Where a server is: `http://HOST[:PORT][/PATH]`.
struct BaseUrl {
    std::string scheme;  ///< `http` or `https`
    std::string host;    ///< a name or an address; an IPv6 address in brackets
    int port = 80;
    std::string path;  ///< under which a proxy offers the server: empty, or `/stipple`

    /// The default port left out.
    std::string text() const { return origin() + path; }
    /// Without the path.
    std::string origin() const;
    /// The path on the host of one in the server's own terms; those of links have the prefix.
    std::string on_host(const std::string& server_path) const;
};

/// @throws Error(InvalidArgument) saying what is wrong with it.
BaseUrl parse_base_url(std::string_view text);

}  // namespace stipple
