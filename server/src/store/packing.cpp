#include "store/packing.hpp"

#include "stipple/error.hpp"

#include <brotli/encode.h>
#include <zlib.h>
#include <algorithm>
#include <cstdint>
#include <memory>

namespace stipple::server {

namespace {

constexpr std::size_t kPiece = 64 * 1024;

std::vector<std::byte> gzip(std::span<const std::byte> bytes, int level) {
    constexpr int kGzipHeader = 16, kMemory = 9;
    z_stream stream{};
    if (::deflateInit2(&stream, level, Z_DEFLATED, MAX_WBITS + kGzipHeader, kMemory,
                       Z_DEFAULT_STRATEGY) != Z_OK) {
        throw Error(ErrorCode::Internal, "zlib cannot begin");
    }
    const std::unique_ptr<z_stream, int (*)(z_stream*)> end(&stream, ::deflateEnd);
    std::vector<std::byte> packed(::deflateBound(&stream, static_cast<uLong>(bytes.size())));
    // zlib reads what it takes for mutable, and does not write there.
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<std::byte*>(bytes.data()));
    stream.avail_in = static_cast<uInt>(bytes.size());
    stream.next_out = reinterpret_cast<Bytef*>(packed.data());
    stream.avail_out = static_cast<uInt>(packed.size());
    if (::deflate(&stream, Z_FINISH) != Z_STREAM_END)
        throw Error(ErrorCode::Internal, "zlib did not end");
    packed.resize(stream.total_out);
    return packed;
}

/// Piece by piece, so that it can be stopped. Empty then, and when it becomes no smaller.
std::vector<std::byte> brotli(std::span<const std::byte> bytes, int level,
                              const std::stop_token& stop) {
    const std::unique_ptr<BrotliEncoderState, void (*)(BrotliEncoderState*)> encoder(
        ::BrotliEncoderCreateInstance(nullptr, nullptr, nullptr), ::BrotliEncoderDestroyInstance);
    if (!encoder) throw Error(ErrorCode::Internal, "Brotli cannot begin");
    ::BrotliEncoderSetParameter(encoder.get(), BROTLI_PARAM_QUALITY,
                                static_cast<std::uint32_t>(level));
    ::BrotliEncoderSetParameter(encoder.get(), BROTLI_PARAM_SIZE_HINT,
                                static_cast<std::uint32_t>(bytes.size()));
    std::vector<std::byte> packed(bytes.size());
    std::size_t room = packed.size();
    auto* out = reinterpret_cast<std::uint8_t*>(packed.data());
    while (!::BrotliEncoderIsFinished(encoder.get())) {
        if (stop.stop_requested() || room == 0) return {};
        std::size_t piece = std::min(bytes.size(), kPiece);
        const auto* in = reinterpret_cast<const std::uint8_t*>(bytes.data());
        bytes = bytes.subspan(piece);
        const auto operation = bytes.empty() ? BROTLI_OPERATION_FINISH : BROTLI_OPERATION_PROCESS;
        if (!::BrotliEncoderCompressStream(encoder.get(), operation, &piece, &in, &room, &out,
                                           nullptr)) {
            throw Error(ErrorCode::Internal, "Brotli did not end");
        }
        if (piece != 0) return {};  // no room
    }
    packed.resize(packed.size() - room);
    return packed;
}

}  // namespace

std::string_view to_string(Coding coding) noexcept {
    switch (coding) {
        case Coding::Identity:
            return "identity";
        case Coding::Gzip:
            return "gzip";
        case Coding::Brotli:
            return "br";
    }
    return "";
}

std::optional<std::vector<std::byte>> pack(std::span<const std::byte> bytes, const Packing& packing,
                                           std::stop_token stop) {
    std::vector<std::byte> packed = packing.coding == Coding::Gzip
                                        ? gzip(bytes, packing.level)
                                        : brotli(bytes, packing.level, stop);
    packed.shrink_to_fit();
    const bool pays = packed.size() < bytes.size() - bytes.size() / 20;
    if (packed.empty() || !pays) return std::nullopt;
    return packed;
}

}  // namespace stipple::server
