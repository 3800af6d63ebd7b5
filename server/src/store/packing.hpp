#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <stop_token>
#include <string_view>
#include <vector>

namespace stipple::server {

/// Content codings (RFC 9110 §8.4.1) in which files are sent beside their plain bytes.
enum class Coding { Identity, Gzip, Brotli };
/// As in `Content-Encoding`: `identity`, `gzip`, `br`.
std::string_view to_string(Coding coding) noexcept;

/// A way to pack a file. The name tells its bytes apart from those of any other way: it stands in
/// the entity tag and in the name of the stored copy.
struct Packing {
    Coding coding;
    int level;
    std::string_view name;
};
inline constexpr Packing kGzip{Coding::Gzip, 6, "gz6"};
inline constexpr Packing kQuickBrotli{Coding::Brotli, 5, "br5"};   ///< about 30 MB a second
inline constexpr Packing kBestBrotli{Coding::Brotli, 11, "br11"};  ///< about 0.5 MB a second

/// Larger files are sent as they are: levels that are fetched once, and for which a packed copy
/// would have to be kept in memory.
inline constexpr std::size_t kMaxPackedSource = 4U << 20;

/// The packed bytes, the same for the same input; nothing when they do not pay (5 % less is asked
/// for), or when Brotli is stopped, whose best heeds that within a second.
std::optional<std::vector<std::byte>> pack(std::span<const std::byte> bytes, const Packing& packing,
                                           std::stop_token stop = {});

}  // namespace stipple::server
