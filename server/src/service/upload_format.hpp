#pragma once

#include "stipple/codec.hpp"

#include <array>
#include <cstddef>
#include <span>

namespace stipple::server {

/// What can be uploaded.
inline constexpr std::array kUploadFormats = {CloudFormat::Ply, CloudFormat::Draco,
                                              CloudFormat::Progressive};

/// Enough of the first bytes to tell these, and what else is sent, apart.
inline constexpr std::size_t kUploadHeadBytes = 64;

/// The format of an upload by its first bytes. @throws Error(UnsupportedFormat) for every other,
/// saying what it probably is.
CloudFormat upload_format(std::span<const std::byte> head);

}  // namespace stipple::server
