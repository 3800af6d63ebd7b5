#include "base_url.hpp"

#include "stipple/error.hpp"

#include <algorithm>
#include <charconv>

namespace stipple {
namespace {

[[noreturn]] void refuse(std::string_view text, const std::string& why) {
    throw Error(ErrorCode::InvalidArgument, "server address '" + std::string(text) + "': " + why +
                                                ": expected http://HOST[:PORT][/PATH]");
}

int default_port(std::string_view scheme) {
    return scheme == "https" ? 443 : 80;
}

bool is_host_character(char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '-' ||
           c == '.' || c == '_';
}

bool is_path_character(char c) {
    return is_host_character(c) || c == '/';
}

bool is_address_character(char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f') || (c >= 'A' && c <= 'F') || c == ':' ||
           c == '.';
}

int parse_port(std::string_view text, std::string_view digits) {
    int port = 0;
    const char* const end = digits.data() + digits.size();
    const auto [stop, error] = std::from_chars(digits.data(), end, port);
    if (error != std::errc() || stop != end || port < 1 || port > 65535)
        refuse(text, "port '" + std::string(digits) + "' is not 1..65535");
    return port;
}

}  // namespace

std::string BaseUrl::origin() const {
    const std::string address = scheme + "://" + host;
    return port == default_port(scheme) ? address : address + ":" + std::to_string(port);
}

std::string BaseUrl::on_host(const std::string& server_path) const {
    return server_path.starts_with(path + "/") ? server_path : path + server_path;
}

BaseUrl parse_base_url(std::string_view text) {
    BaseUrl url;
    const std::size_t separator = text.find("://");
    if (separator == std::string_view::npos) refuse(text, "no scheme");
    url.scheme = text.substr(0, separator);
    if (url.scheme != "http" && url.scheme != "https")
        refuse(text, "scheme '" + url.scheme + "' is not supported");

    std::string_view rest = text.substr(separator + 3);
    if (rest.ends_with('/')) rest.remove_suffix(1);
    if (rest.find_first_of("?#") != std::string_view::npos) refuse(text, "a query is not allowed");
    const std::size_t path_begin = std::min(rest.find('/'), rest.size());
    url.path = rest.substr(path_begin);
    rest = rest.substr(0, path_begin);
    if (!std::ranges::all_of(url.path, is_path_character) ||
        (url.path + '/').find("//") != std::string::npos)
        refuse(text, "path '" + url.path +
                         "' has an empty part, or other than letters, digits, '-', '_' and '.'");
    if (rest.find('@') != std::string_view::npos)
        refuse(text, "a name or password is not allowed (use an API key)");

    const bool bracketed = rest.starts_with('[');
    const std::size_t host_end =
        bracketed ? rest.find(']') + 1 : std::min(rest.find(':'), rest.size());
    if (bracketed && host_end == 0) refuse(text, "no ']' after the address");
    const std::string_view host = rest.substr(0, host_end);
    const std::string_view inner = bracketed ? host.substr(1, host.size() - 2) : host;
    if (inner.empty()) refuse(text, "no host");
    if (!std::all_of(inner.begin(), inner.end(),
                     bracketed ? is_address_character : is_host_character))
        refuse(text, "host '" + std::string(host) + "' contains an invalid character");
    url.host = host;

    rest.remove_prefix(host_end);
    if (!rest.empty() && rest.front() != ':')
        refuse(text, "'" + std::string(rest) + "' after the host");
    url.port = rest.empty() ? default_port(url.scheme) : parse_port(text, rest.substr(1));
    return url;
}

}  // namespace stipple
