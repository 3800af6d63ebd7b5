// Any bytes: a cloud that is whole and goes through the writer, or one Error.

#include "stipple/codec.hpp"
#include "stipple/error.hpp"

#include <cstdlib>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace stipple;
    RunContext context;
    context.threads = 1;
    try {
        const PointCloud cloud = decode_cloud(std::as_bytes(std::span(data, size)), {}, context);
        validate(cloud);
        const std::vector<std::byte> written = encode_ply(cloud, {}, context);
        if (decode_cloud(written, {}, context).size() != cloud.size()) std::abort();
    } catch (const Error&) {
    }
    return 0;
}
