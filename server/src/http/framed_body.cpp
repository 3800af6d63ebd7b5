#include "http/framed_body.hpp"

#include <algorithm>
#include <array>
#include <charconv>

namespace stipple::server::http {

namespace {

constexpr std::size_t kMaxChunkLine = 256;
constexpr std::size_t kMaxTrailerBytes = 4096;

/// Hexadecimal digits and, perhaps, an extension that nobody reads: no sign, no blank, no prefix.
std::uint64_t parse_chunk_size(std::string_view line) {
    const std::string_view digits = line.substr(0, line.find(';'));
    std::uint64_t size = 0;
    const auto [end, error] =
        std::from_chars(digits.data(), digits.data() + digits.size(), size, 16);
    const bool clean =
        std::ranges::none_of(line, [](char c) { return c != '\t' && (c < ' ' || c == 0x7F); });
    if (error != std::errc() || end != digits.data() + digits.size() || size > INT64_MAX ||
        !clean) {
        throw HttpError(400, "a chunk does not begin with its size in hexadecimal digits");
    }
    return size;
}

}  // namespace

FramedBody::FramedBody(const RequestHead& head, ByteSource source, std::function<void()> go_on)
    : length_(head.content_length),
      chunked_(head.chunked),
      source_(std::move(source)),
      go_on_(std::move(go_on)),
      left_(head.content_length.value_or(0)),
      finished_(!head.has_body()) {}

std::size_t FramedBody::read(std::span<std::byte> out) {
    if (finished_) return 0;
    if (const auto go_on = std::exchange(go_on_, nullptr)) go_on();
    if (chunked_ && left_ == 0) begin_chunk();
    if (finished_) return 0;
    const std::size_t wanted = static_cast<std::size_t>(std::min<std::uint64_t>(out.size(), left_));
    const std::size_t n = source_(out.first(wanted));
    left_ -= n;
    if (!chunked_) finished_ = left_ == 0;
    return n;
}

void FramedBody::begin_chunk() {
    if (std::exchange(in_chunk_, true) && !read_line(0).empty()) {
        throw HttpError(400, "a chunk is longer than its size");
    }
    left_ = parse_chunk_size(read_line(kMaxChunkLine));
    if (left_ == 0) read_trailers();
}

std::string FramedBody::read_line(std::size_t max_bytes) {
    std::string line;
    std::array<std::byte, 1> byte;
    while (!line.ends_with("\r\n")) {
        if (line.size() == max_bytes + 2)
            throw HttpError(400, "a chunk is not followed by a line end");
        source_(byte);
        line += static_cast<char>(byte[0]);
    }
    line.resize(line.size() - 2);
    return line;
}

void FramedBody::read_trailers() {
    std::size_t bytes = 0;
    while (true) {
        const std::string line = read_line(kMaxTrailerBytes);
        if (line.empty()) break;
        bytes += line.size();
        if (bytes > kMaxTrailerBytes) {
            throw HttpError(431,
                            "trailers of more than " + std::to_string(kMaxTrailerBytes) + " bytes");
        }
    }
    finished_ = true;
}

}  // namespace stipple::server::http
