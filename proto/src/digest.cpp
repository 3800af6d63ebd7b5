#include "stipple/proto/digest.hpp"

#include "stipple/error.hpp"

#include <openssl/evp.h>
#include <openssl/rand.h>
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string_view>
#include <vector>

namespace stipple::proto {

namespace {

constexpr std::size_t kSha256Bytes = 32;
constexpr std::size_t kReadBlock = 256 * 1024;

std::string hexadecimal(std::span<const unsigned char> bytes) {
    static constexpr std::string_view kDigits = "0123456789abcdef";
    std::string text;
    text.reserve(2 * bytes.size());
    for (const unsigned char byte : bytes) {
        text += kDigits[byte >> 4];
        text += kDigits[byte & 15];
    }
    return text;
}

/// OpenSSL fails here only when memory or its configuration does.
void require(bool done, const char* what) {
    if (!done) throw Error(ErrorCode::Internal, std::string("OpenSSL: ") + what + " failed");
}

}  // namespace

struct Sha256::State {
    std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context{EVP_MD_CTX_new(),
                                                                    &EVP_MD_CTX_free};
};

Sha256::Sha256() : state_(std::make_unique<State>()) {
    require(state_->context != nullptr, "EVP_MD_CTX_new");
    require(EVP_DigestInit_ex(state_->context.get(), EVP_sha256(), nullptr) == 1,
            "EVP_DigestInit_ex");
}

Sha256::~Sha256() = default;
Sha256::Sha256(Sha256&&) noexcept = default;
Sha256& Sha256::operator=(Sha256&&) noexcept = default;

void Sha256::update(std::span<const std::byte> bytes) {
    require(EVP_DigestUpdate(state_->context.get(), bytes.data(), bytes.size()) == 1,
            "EVP_DigestUpdate");
}

std::string Sha256::finish() {
    unsigned char digest[kSha256Bytes];
    require(EVP_DigestFinal_ex(state_->context.get(), digest, nullptr) == 1, "EVP_DigestFinal_ex");
    return hexadecimal(digest);
}

std::string sha256_hex(std::span<const std::byte> bytes) {
    Sha256 hash;
    hash.update(bytes);
    return hash.finish();
}

std::string sha256_of_file(const std::filesystem::path& file) {
    const auto fail = [&file] {
        const bool is_missing = errno == ENOENT || errno == ENOTDIR;
        return Error(is_missing ? ErrorCode::NotFound : ErrorCode::Internal,
                     file.string() + ": " + std::strerror(errno));
    };
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> in(std::fopen(file.c_str(), "rbe"),
                                                             &std::fclose);
    if (!in) throw fail();

    Sha256 hash;
    std::vector<std::byte> block(kReadBlock);
    while (const std::size_t n = std::fread(block.data(), 1, block.size(), in.get())) {
        hash.update({block.data(), n});
    }
    if (std::ferror(in.get()) != 0) throw fail();
    return hash.finish();
}

bool is_sha256(std::string_view text) noexcept {
    return text.size() == 2 * kSha256Bytes && std::ranges::all_of(text, [](char c) {
               return ('0' <= c && c <= '9') || ('a' <= c && c <= 'f');
           });
}

std::string base64(std::span<const std::byte> bytes) {
    std::string text((bytes.size() + 2) / 3 * 4 + 1, '\0');  // OpenSSL ends it with a null
    ::EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()),
                      reinterpret_cast<const unsigned char*>(bytes.data()),
                      static_cast<int>(bytes.size()));
    text.pop_back();
    return text;
}

std::string base64url(std::span<const std::byte> bytes) {
    std::string text = base64(bytes);
    text.resize(std::min(text.find('='), text.size()));
    std::ranges::replace(text, '+', '-');
    std::ranges::replace(text, '/', '_');
    return text;
}

std::optional<std::string> from_base64url(std::string_view text) {
    std::string padded(text);
    std::ranges::replace(padded, '-', '+');
    std::ranges::replace(padded, '_', '/');
    padded.resize((text.size() + 3) / 4 * 4, '=');
    std::string bytes(padded.size() / 4 * 3, '\0');
    const int decoded = ::EVP_DecodeBlock(reinterpret_cast<unsigned char*>(bytes.data()),
                                          reinterpret_cast<const unsigned char*>(padded.data()),
                                          static_cast<int>(padded.size()));
    const std::size_t padding = padded.size() - text.size();  // decoded to as many zeros
    if (decoded < static_cast<int>(padding)) return std::nullopt;
    bytes.resize(static_cast<std::size_t>(decoded) - padding);
    return bytes;
}

std::string random_hex(std::size_t bytes) {
    std::vector<unsigned char> random(bytes);
    require(RAND_bytes(random.data(), static_cast<int>(random.size())) == 1, "RAND_bytes");
    return hexadecimal(random);
}

}  // namespace stipple::proto
