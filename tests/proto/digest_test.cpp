#include "stipple/proto/digest.hpp"

#include "stipple/error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <fstream>
#include <string>
#include <string_view>

namespace stipple::proto {
namespace {

std::span<const std::byte> bytes_of(std::string_view text) {
    return std::as_bytes(std::span(text.data(), text.size()));
}

// FIPS 180-2, appendix B.1, and the digest of the empty text.
constexpr std::string_view kAbc =
    "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
constexpr std::string_view kNothing =
    "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";

TEST(Sha256, HasTheDigestsOfTheStandard) {
    EXPECT_EQ(sha256_hex(bytes_of("abc")), kAbc);
    EXPECT_EQ(sha256_hex({}), kNothing);
}

TEST(Sha256, DoesNotDependOnHowTheBytesComeBy) {
    Sha256 hash;
    hash.update(bytes_of("a"));
    hash.update({});
    hash.update(bytes_of("bc"));
    EXPECT_EQ(hash.finish(), kAbc);
}

TEST(Sha256, OfAFileIsThatOfItsBytesAlsoBeyondOneBlock) {
    const test::TemporaryFolder folder;
    const std::string text(1'000'003, 'x');
    std::ofstream(folder / "file") << text;
    EXPECT_EQ(sha256_of_file(folder / "file"), sha256_hex(bytes_of(text)));
}

TEST(Sha256, OfAMissingFileNamesTheFile) {
    try {
        sha256_of_file("/no/such/file");
        FAIL() << "no error";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::NotFound);
        EXPECT_NE(std::string(error.what()).find("/no/such/file"), std::string::npos);
    }
}

TEST(Sha256, TextIsKnownByItsLengthAndLowerCaseDigits) {
    EXPECT_TRUE(is_sha256(kAbc));
    EXPECT_FALSE(is_sha256(kAbc.substr(1)));
    EXPECT_FALSE(is_sha256(std::string(kAbc) + "0"));
    EXPECT_FALSE(is_sha256(std::string(64, 'A')));
    EXPECT_FALSE(is_sha256(std::string(63, 'a') + "/"));
    EXPECT_FALSE(is_sha256(""));
}

TEST(Base64, IsThatOfTheStandardsExamples) {
    const auto coded = [](std::string_view text) { return base64(std::as_bytes(std::span(text))); };
    EXPECT_EQ(coded(""), "");
    EXPECT_EQ(coded("f"), "Zg==");
    EXPECT_EQ(coded("fo"), "Zm8=");
    EXPECT_EQ(coded("foobar"), "Zm9vYmFy");
}

TEST(Base64Url, HasNoPaddingAndComesBack) {
    const auto coded = [](std::string_view text) {
        return base64url(std::as_bytes(std::span(text)));
    };
    EXPECT_EQ(coded("fo"), "Zm8");
    EXPECT_EQ(coded("\xFB\xFF"), "-_8");
    for (const std::string_view text : {"", "f", "fo", "foo", "jobs:7", "\xFB\xFF\xFE"})
        EXPECT_EQ(from_base64url(coded(text)), text);
}

TEST(Base64Url, OfAnotherTextIsRefused) {
    for (const std::string_view text : {"Zm 8", "Zm8.", "\n\n\nA", "Zm\n8", "é"})
        EXPECT_EQ(from_base64url(text), std::nullopt) << text;
}

TEST(RandomHex, HasTwoDigitsAByteAndDiffersEveryTime) {
    EXPECT_EQ(random_hex(16).size(), 32U);
    EXPECT_NE(random_hex(16), random_hex(16));
    EXPECT_EQ(random_hex(0), "");
}

}  // namespace
}  // namespace stipple::proto
