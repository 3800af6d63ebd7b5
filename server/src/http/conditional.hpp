#pragma once

#include "http/message.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace stipple::server::http {

/// The part of `size` bytes that a `Range` field asks for: nothing when it is to be ignored
/// (another unit, malformed, several ranges: 1000 of them would be a weapon). @throws
/// HttpError(416) with `Content-Range`.
struct ByteRange {
    std::uint64_t offset = 0, length = 0;
};
std::optional<ByteRange> parse_range(std::string_view field, std::uint64_t size);

/// Whether `If-None-Match` names this tag (in quotes).
bool none_match_names(std::string_view field, std::string_view etag);

/// A blob under a strong tag: 200, 206, 304 or 416.
Reply blob_reply(const Request& request, std::shared_ptr<const BlobReader> blob,
                 const std::string& sha256, std::string_view media_type, bool only_for_tenant);

/// Bytes that may change, under a tag that does with them: 200 or 304. `cache` as in
/// `Cache-Control`.
Reply tagged_reply(const Request& request, std::string etag, std::string cache, Reply reply);

}  // namespace stipple::server::http
