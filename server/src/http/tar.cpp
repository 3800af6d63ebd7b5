#include "http/tar.hpp"

#include <array>
#include <cassert>
#include <cstring>
#include <numeric>

namespace stipple::server::http {

namespace {

constexpr std::size_t kBlock = 512;

struct Field {
    std::size_t at, size;
};
constexpr Field kName{0, 100}, kMode{100, 8}, kUser{108, 8}, kGroup{116, 8}, kSize{124, 12},
    kModified{136, 12}, kChecksum{148, 8}, kMagic{257, 8};
constexpr std::size_t kType = 156;

/// Digits to the end of the field but one, which is zero.
void put_octal(std::string& header, Field field, std::uint64_t value) {
    for (std::size_t i = field.size - 1; i-- > 0; value /= 8)
        header[field.at + i] = static_cast<char>('0' + value % 8);
}

void put_binary(std::string& header, Field field, std::uint64_t value) {
    for (std::size_t i = field.size; i-- > 0; value /= 256)
        header[field.at + i] = static_cast<char>(value % 256);
    header[field.at] = static_cast<char>(0x80);
}

}  // namespace

std::string tar_header(std::string_view name, std::uint64_t bytes,
                       std::chrono::sys_seconds modified) {
    assert(!name.empty() && name.size() <= kName.size);
    constexpr std::uint64_t kMostOctal = 1ULL << 33;
    std::string header(kBlock, '\0');
    header.replace(kName.at, name.size(), name);
    put_octal(header, kMode, 0644);
    put_octal(header, kUser, 0);
    put_octal(header, kGroup, 0);
    bytes < kMostOctal ? put_octal(header, kSize, bytes) : put_binary(header, kSize, bytes);
    put_octal(header, kModified, static_cast<std::uint64_t>(modified.time_since_epoch().count()));
    header[kType] = '0';
    header.replace(kMagic.at, kMagic.size, std::string_view("ustar\00000", kMagic.size));
    // Of the header with blanks where the checksum will stand.
    header.replace(kChecksum.at, kChecksum.size, kChecksum.size, ' ');
    const auto sum =
        std::accumulate(header.begin(), header.end(), std::uint64_t{0},
                        [](std::uint64_t s, char c) { return s + static_cast<unsigned char>(c); });
    put_octal(header, {kChecksum.at, kChecksum.size - 1}, sum);
    header[kChecksum.at + kChecksum.size - 2] = '\0';
    return header;
}

std::string tar_padding(std::uint64_t bytes) {
    return std::string((kBlock - bytes % kBlock) % kBlock, '\0');
}

std::uint64_t tar_bytes(std::uint64_t bytes) noexcept {
    return (1 + (bytes + kBlock - 1) / kBlock) * kBlock;
}

std::string tar_end() {
    return std::string(2 * kBlock, '\0');
}

}  // namespace stipple::server::http
