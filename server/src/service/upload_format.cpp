#include "service/upload_format.hpp"

#include "stipple/error.hpp"

#include <algorithm>
#include <string>
#include <string_view>

namespace stipple::server {

namespace {

std::string remedy_for(std::string_view head) {
    using namespace std::string_view_literals;
    constexpr std::array kPacked = {"\x1F\x8B"sv, "PK\x03\x04"sv, "\x28\xB5\x2F\xFD"sv};
    if (head.starts_with("ply")) {
        return "it begins with `ply`, but no line break follows: send the bytes as they are, with "
               "curl by --data-binary, since -d takes line breaks out";
    }
    if (std::ranges::any_of(kPacked, [head](auto magic) { return head.starts_with(magic); }))
        return "it is a packed file: unpack it first";
    if (head.starts_with("LASF")) return "it is a LAS or LAZ file: convert it to PLY first";
    return "expected it to begin with `ply` and a line break, `DRACO` or `STPC`";
}

}  // namespace

CloudFormat upload_format(std::span<const std::byte> head) {
    if (head.empty()) {
        throw Error(ErrorCode::UnsupportedFormat,
                    "the body is empty: expected the bytes of a PLY file, a Draco file or a "
                    "progressive stream");
    }
    const auto format = detect_format(head);
    if (format && std::ranges::find(kUploadFormats, *format) != kUploadFormats.end())
        return *format;
    const std::string_view text(reinterpret_cast<const char*>(head.data()), head.size());
    throw Error(ErrorCode::UnsupportedFormat,
                "the body is neither PLY, Draco nor a progressive stream: " + remedy_for(text));
}

}  // namespace stipple::server
