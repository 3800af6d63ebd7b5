#include "store/packing.hpp"

#include "stipple/error.hpp"

#include <brotli/encode.h>
#include <zlib.h>
#include <algorithm>
#include <csetjmp>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>

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

/// What Brotli takes. Where there is no more, Brotli 1.0 ends the process: it is left by a jump to
/// `ran_out` instead, over frames of C alone, and all that it took is given back in the end.
class BrotliMemory {
public:
    BrotliMemory() = default;
    BrotliMemory(const BrotliMemory&) = delete;
    BrotliMemory& operator=(const BrotliMemory&) = delete;
    ~BrotliMemory() {
        while (last_ != nullptr) give_back(last_);
    }

    static void* take(void* memory, std::size_t bytes) {
        auto& self = *static_cast<BrotliMemory*>(memory);
        void* const room = std::malloc(sizeof(Block) + bytes);
        if (room == nullptr) std::longjmp(self.ran_out, 1);
        auto* const block = new (room) Block{self.last_, nullptr};
        if (self.last_ != nullptr) self.last_->after = block;
        self.last_ = block;
        return block + 1;
    }
    static void release(void* memory, void* bytes) {
        if (bytes != nullptr)
            static_cast<BrotliMemory*>(memory)->give_back(static_cast<Block*>(bytes) - 1);
    }

    std::jmp_buf ran_out{};

private:
    struct alignas(std::max_align_t) Block {
        Block *before, *after;
    };

    void give_back(Block* block) {
        (block->after != nullptr ? block->after->before : last_) = block->before;
        if (block->before != nullptr) block->before->after = block->after;
        std::free(block);
    }

    Block* last_ = nullptr;
};

/// Piece by piece, so that it can be stopped. Has no object with a destructor, since a jump may
/// leave it. @returns how many bytes were written; 0 when stopped, or when they become no fewer.
[[gnu::noinline]] std::size_t brotli_into(std::span<std::byte> packed,
                                          std::span<const std::byte> bytes, int level,
                                          const std::stop_token& stop, BrotliMemory& memory) {
    BrotliEncoderState* const encoder =
        ::BrotliEncoderCreateInstance(BrotliMemory::take, BrotliMemory::release, &memory);
    ::BrotliEncoderSetParameter(encoder, BROTLI_PARAM_QUALITY, static_cast<std::uint32_t>(level));
    ::BrotliEncoderSetParameter(encoder, BROTLI_PARAM_SIZE_HINT,
                                static_cast<std::uint32_t>(bytes.size()));
    std::size_t room = packed.size();
    auto* out = reinterpret_cast<std::uint8_t*>(packed.data());
    while (!::BrotliEncoderIsFinished(encoder)) {
        if (stop.stop_requested() || room == 0) return 0;
        std::size_t piece = std::min(bytes.size(), kPiece);
        const auto* in = reinterpret_cast<const std::uint8_t*>(bytes.data());
        bytes = bytes.subspan(piece);
        const auto operation = bytes.empty() ? BROTLI_OPERATION_FINISH : BROTLI_OPERATION_PROCESS;
        if (!::BrotliEncoderCompressStream(encoder, operation, &piece, &in, &room, &out, nullptr))
            throw Error(ErrorCode::Internal, "Brotli did not end");
        if (piece != 0) return 0;  // no room
    }
    return packed.size() - room;
}

/// Empty when stopped, and when it becomes no smaller.
std::vector<std::byte> brotli(std::span<const std::byte> bytes, int level,
                              const std::stop_token& stop) {
    std::vector<std::byte> packed(bytes.size());
    BrotliMemory memory;
    if (setjmp(memory.ran_out) != 0) throw std::bad_alloc();
    packed.resize(brotli_into(packed, bytes, level, stop, memory));
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
