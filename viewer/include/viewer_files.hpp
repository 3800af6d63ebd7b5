#pragma once

#include <cstddef>
#include <span>
#include <string_view>

namespace stipple::viewer {

/// A file of the web page, built into the program.
struct File {
    /// As in the URL: `/` is the page; the rest is `/assets/NAME-HASH.EXTENSION`, with a hash of
    /// the content, so that it may be cached for ever.
    std::string_view path;
    std::string_view media_type;  ///< as sent in `Content-Type`
    std::string_view etag;        ///< hexadecimal digits, without quotes; of `identity`
    std::span<const std::byte> identity;
    std::span<const std::byte> brotli;  ///< for `Content-Encoding: br`; empty where not smaller
};

/// All files of the page, sorted by path; none when the program was built without the viewer.
std::span<const File> files();

/// What the page needs and no more; sent as `Content-Security-Policy` with `/`. The Draco decoder
/// is WebAssembly in a worker that three.js makes from a blob.
inline constexpr std::string_view kContentSecurityPolicy =
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self' blob:; "
    "style-src 'self'; img-src 'self' data:; connect-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

}  // namespace stipple::viewer
