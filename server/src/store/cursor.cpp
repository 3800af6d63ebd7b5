#include "store/cursor.hpp"

#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"

#include <algorithm>
#include <charconv>
#include <span>

namespace stipple::server {

std::string encode_cursor(std::string_view listing, std::int64_t row) {
    const std::string text = std::string(listing) + ':' + std::to_string(row);
    return proto::base64url(std::as_bytes(std::span(text)));
}

std::int64_t decode_cursor(std::string_view listing, std::string_view cursor) {
    constexpr std::size_t kLongest = 64;
    const std::string text = proto::from_base64url(cursor.substr(0, kLongest)).value_or("");
    const std::size_t colon = text.find(':');
    std::int64_t row = 0;
    if (colon != std::string::npos) {
        std::from_chars(text.data() + colon + 1, text.data() + text.size(), row);
    }
    // Written again, it must be what came: one row has one cursor.
    if (row <= 0 || encode_cursor(listing, row) != cursor) {
        std::string shown(cursor.substr(0, kLongest));
        std::ranges::replace(shown, '\0', '?');  // at which the text of an exception would end
        throw Error(ErrorCode::InvalidArgument,
                    "cursor \"" + shown +
                        "\": expected the `next` of a page of this listing; omit it for the "
                        "first page");
    }
    return row;
}

}  // namespace stipple::server
