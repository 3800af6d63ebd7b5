// Any bytes, in two pieces: a cloud that is whole, or one Error.

#include "stipple/error.hpp"
#include "stipple/progressive_cloud.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace stipple;
    try {
        const auto bytes = std::as_bytes(std::span(data, size));
        ProgressiveDecoder decoder({.max_points = 100'000});
        decoder.feed(bytes.first(size / 2));
        decoder.feed(bytes.subspan(size / 2));
        validate(decoder.cloud());
    } catch (const Error&) {
    }
    return 0;
}
