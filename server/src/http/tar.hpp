#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

namespace stipple::server::http {

/// The 512 bytes before a file of a tar archive (POSIX.1-1988 ustar): a plain file that all may
/// read. A file of 8 GiB or more has its size in binary, as GNU tar has it. Made here, since files
/// stream from the store between headers, which archive libraries would rather write themselves.
/// @param name  1 to 100 bytes.
std::string tar_header(std::string_view name, std::uint64_t bytes,
                       std::chrono::sys_seconds modified);

/// The zeros after a file of so many bytes, up to the next 512.
std::string tar_padding(std::uint64_t bytes);

/// What a file of so many bytes takes: its header, itself, its padding.
std::uint64_t tar_bytes(std::uint64_t bytes) noexcept;

/// The end of an archive.
std::string tar_end();

}  // namespace stipple::server::http
