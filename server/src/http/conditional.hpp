#pragma once

#include "http/message.hpp"
#include "service/outputs.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stipple::server::http {

/// The part of `size` bytes that a `Range` field asks for: nothing when it is to be ignored
/// (another unit, malformed, several ranges: 1000 of them would be a weapon). @throws
/// HttpError(416) with `Content-Range`.
struct ByteRange {
    std::uint64_t offset = 0, length = 0;
};
std::optional<ByteRange> parse_range(std::string_view field, std::uint64_t size);

/// An item of a list like `Accept`: what it names, and its `q`, 1 where none is given, 0 for one
/// that is no number of 0..1.
struct ListItem {
    std::string_view name;
    double quality = 1;
};
ListItem list_item(std::string_view text);

/// Whether `If-None-Match` names this tag (in quotes).
bool none_match_names(std::string_view field, std::string_view etag);

/// The codings that `Accept-Encoding` takes, best first; identity last where nothing puts it
/// elsewhere. Among equals Brotli stands before gzip.
std::vector<Coding> accepted_codings(const Request& request);

/// The same, for a file of which a part may be asked for: ranges are of the plain bytes alone.
std::vector<Coding> accepted_file_codings(const Request& request);

/// What caches are told of bytes that never change: one year is what they take for ever.
std::string immutable(bool only_for_tenant);

/// A stored file under its strong tag: 200, 206, 304 or 416. `cache` as in `Cache-Control`.
Reply file_reply(const Request& request, StoredFile file, std::string_view media_type,
                 std::string cache);

/// Bytes that may change, under a tag that does with them: 200 or 304. `cache` as in
/// `Cache-Control`.
Reply tagged_reply(const Request& request, std::string etag, std::string cache, Reply reply);

}  // namespace stipple::server::http
