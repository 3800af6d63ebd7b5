#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace stipple::proto {

/// SHA-256 of a stream of bytes.
class Sha256 {
public:
    Sha256();
    ~Sha256();
    Sha256(Sha256&&) noexcept;
    Sha256& operator=(Sha256&&) noexcept;

    void update(std::span<const std::byte> bytes);
    /// 64 lower-case hexadecimal digits. Call once, at the end.
    std::string finish();

private:
    struct State;
    std::unique_ptr<State> state_;
};

std::string sha256_hex(std::span<const std::byte> bytes);
/// @throws Error(NotFound) for a missing file; Error(Internal) when it cannot be read.
std::string sha256_of_file(const std::filesystem::path& file);
/// Whether `text` is 64 lower-case hexadecimal digits.
bool is_sha256(std::string_view text) noexcept;
/// RFC 4648, with padding.
std::string base64(std::span<const std::byte> bytes);
/// In the alphabet for addresses (RFC 4648, 5), without padding.
std::string base64url(std::span<const std::byte> bytes);
/// The bytes of a `base64url`; nothing of another text, mostly: who must know encodes them again.
std::optional<std::string> from_base64url(std::string_view text);
/// `bytes` random bytes from the system, in lower-case hexadecimal.
std::string random_hex(std::size_t bytes);

}  // namespace stipple::proto
