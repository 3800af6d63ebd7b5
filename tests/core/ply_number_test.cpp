#include "codec/ply_number.hpp"

#include <gtest/gtest.h>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <random>
#include <string>
#include <string_view>
#include <utility>

namespace stipple {
namespace {

template <typename T>
void expect_as_from_chars(const std::string& word) {
    T expected{};
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), expected);
    if (error != std::errc()) return;
    T got{};
    ASSERT_EQ(ply_number::parse(word.data(), word.data() + word.size(), got),
              word.data() + word.size())
        << word;
    ASSERT_EQ(std::memcmp(&got, &expected, sizeof(T)), 0)
        << word << ": " << got << " for " << expected;
}

TEST(PlyNumber, IsExactlyAsAccurateAsFromChars) {
    std::mt19937_64 random(3);
    std::array<char, 64> text;
    for (int i = 0; i < 300'000; ++i) {
        const std::uint64_t bits = random();
        const auto narrow = std::bit_cast<float>(static_cast<std::uint32_t>(bits));
        const auto wide = std::bit_cast<double>(bits);
        for (const int digits : {1, 4, 6, 7, 9, 12, 17}) {
            const double plain = std::ldexp(static_cast<double>(bits >> 11), -int(bits % 64) - 20);
            for (const auto& [format, value] :
                 {std::pair{"%.*g", double{narrow}}, {"%.*g", wide}, {"%.*f", plain}}) {
                std::snprintf(text.data(), text.size(), format, digits, value);
                expect_as_from_chars<float>(text.data());
                expect_as_from_chars<double>(text.data());
            }
            if (HasFatalFailure()) return;
            i += 1;
        }
    }
    // Exactly between two floats, and a digit to either side of it.
    for (const char* word :
         {"16777217", "16777217.0000001", "16777216.9999999", "1.00000005960464477539",
          "1.000000059604644775390625", "1.0000000596046448", "8388608.5", "8388609.5",
          "0.00000000000000000000000000000000000000000000140129846432e0"}) {
        expect_as_from_chars<float>(word);
        expect_as_from_chars<double>(word);
    }
}

TEST(PlyNumber, RefusesWhatIsNoNumber) {
    for (const std::string_view word : {"-", ".", "e5", "1e", "1e+", "0x10", "1,5", "1.2.3", "--1",
                                        "1f", "#INF", "1.#FOO", "+-1"}) {
        double real = 0;
        int whole = 0;
        EXPECT_EQ(ply_number::parse(word.data(), word.data() + word.size(), real), nullptr) << word;
        EXPECT_EQ(ply_number::parse(word.data(), word.data() + word.size(), whole), nullptr)
            << word;
    }
}

}  // namespace
}  // namespace stipple
