// Any bytes behind the magic ones: a cloud that is whole, or one Error. Google's decoder allocates
// what a file asks for: run with -rss_limit_mb and -malloc_limit_mb, and take what they stop for a
// known limit, not for a finding.

#include "stipple/codec.hpp"
#include "stipple/error.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace stipple;
    RunContext context;
    context.threads = 1;
    try {
        validate(
            decode_cloud(std::as_bytes(std::span(data, size)), {.max_points = 100'000}, context));
    } catch (const Error&) {
    }
    return 0;
}
