#pragma once

#include "http/client_socket.hpp"
#include "http/request_head.hpp"

#include <cstdint>
#include <functional>
#include <string>

namespace stipple::server::http {

/// Where the bytes of a body come from: at least one at a time.
using ByteSource = std::function<std::size_t(std::span<std::byte> out)>;

/// The body of one request, cut out of the connection by its length or its chunks.
class FramedBody : public RequestBody {
public:
    /// @param go_on  called before the first byte is read of a client that waits for `100
    /// Continue`.
    FramedBody(const RequestHead& head, ByteSource source, std::function<void()> go_on);

    bool announced() const noexcept override { return chunked_ || length_.has_value(); }
    std::optional<std::uint64_t> length() const noexcept override { return length_; }
    std::size_t read(std::span<std::byte> out) override;

    /// Whether nothing of it is left on the connection.
    bool finished() const noexcept { return finished_; }

    /// What is still to come of an announced length.
    std::uint64_t left() const noexcept { return length_ && !finished_ ? left_ : 0; }

private:
    void begin_chunk();
    std::string read_line(std::size_t max_bytes);
    void read_trailers();

    const std::optional<std::uint64_t> length_;
    const bool chunked_;
    const ByteSource source_;
    std::function<void()> go_on_;
    std::uint64_t left_;  ///< of the body, or of the chunk under way
    bool in_chunk_ = false;
    bool finished_;
};

}  // namespace stipple::server::http
