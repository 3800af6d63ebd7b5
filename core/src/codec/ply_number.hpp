#pragma once

#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>
#include <string_view>
#include <type_traits>

namespace stipple {

/// Numbers of an ascii PLY body, exactly as accurate as `std::from_chars`, which gets all but the
/// plain cases. A word ends at the next character that is not above a blank. No locale, no
/// allocation.
namespace ply_number {

inline bool is_blank(char c) noexcept {
    return static_cast<unsigned char>(c) <= ' ';
}
inline bool is_digit(char c) noexcept {
    return static_cast<unsigned>(c - '0') < 10U;
}

inline std::string_view word_at(const char* p, const char* end) noexcept {
    const char* q = p;
    while (q != end && !is_blank(*q)) ++q;
    return {p, static_cast<std::size_t>(q - p)};
}

/// Powers of ten that a double holds exactly.
inline constexpr std::array<double, 23> kPowersOfTen = {
    1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
    1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

/// The double nearest to the number is known: is the float nearest to it the float nearest to the
/// number? Not when the double lies exactly between two floats (the number may be on either side),
/// nor where floats are subnormal or end.
inline bool rounds_to_float(double value) noexcept {
    constexpr std::uint64_t kBelowFloat = (std::uint64_t{1} << 29) - 1;
    const double size = std::fabs(value);
    return (std::bit_cast<std::uint64_t>(value) & kBelowFloat) != std::uint64_t{1} << 28 &&
           (size == 0 || (size >= std::numeric_limits<float>::min() &&
                          size <= std::numeric_limits<float>::max()));
}

/// What `from_chars` has no way to say: `+1`, `1.#INF` as old Windows programs print it, and
/// numbers beyond the range, which become infinite or zero as they do in `strtod`.
template <std::floating_point T>
bool parse_unusual_real(std::string_view word, T& value) noexcept {
    if (word.starts_with('+') && !word.starts_with("+-")) word.remove_prefix(1);
    const char* const end = word.data() + word.size();
    const auto [stop, error] = std::from_chars(word.data(), end, value);
    if (error == std::errc() && stop == end) return true;
    const T sign = word.starts_with('-') ? T(-1) : T(1);
    if (error == std::errc::result_out_of_range && stop == end) {
        double wide = 0;
        if (std::from_chars(word.data(), end, wide).ec != std::errc()) {
            const std::size_t exponent = word.find_first_of("eE");
            // Without an exponent it takes hundreds of digits: large when they stand before the
            // point.
            const bool small = exponent != word.npos ? word.substr(exponent + 1).starts_with('-')
                                                     : word.find('.') < 20;
            wide = sign * (small ? 0.0 : std::numeric_limits<double>::infinity());
        }
        value = static_cast<T>(wide);
        return true;
    }
    const std::size_t mark = word.find('#');
    if (mark == word.npos || mark < 2 || word[mark - 1] != '.') return false;
    const std::string_view kind = word.substr(mark + 1, 3);
    if (kind == "INF") {
        value = sign * std::numeric_limits<T>::infinity();
    } else if (kind == "IND" || kind == "QNA" || kind == "SNA") {
        value = std::numeric_limits<T>::quiet_NaN();
    } else {
        return false;
    }
    return true;
}

/// Reads the word at `p` (p < end, not a blank). Returns its end, or null when it is no number of
/// this type.
template <std::floating_point T>
const char* parse(const char* p, const char* end, T& value) noexcept {
    const char* q = p;
    const bool negative = *q == '-';
    q += negative;
    std::uint64_t mantissa = 0;
    const char* const whole = q;
    for (; q != end && is_digit(*q); ++q)
        mantissa = 10 * mantissa + static_cast<unsigned>(*q - '0');
    auto digits = q - whole;
    std::ptrdiff_t exponent = 0;
    if (q != end && *q == '.') {
        const char* const fraction = ++q;
        for (; q != end && is_digit(*q); ++q)
            mantissa = 10 * mantissa + static_cast<unsigned>(*q - '0');
        exponent = fraction - q;
        digits += q - fraction;
    }
    if (q != end && (*q == 'e' || *q == 'E') && digits > 0) {
        const char* const mark = q++;
        const bool down = q != end && *q == '-';
        if (q != end && (*q == '-' || *q == '+')) ++q;
        int power = 0;
        const char* const first = q;
        for (; q != end && is_digit(*q) && q - first < 4; ++q) power = 10 * power + (*q - '0');
        if (q == first) q = mark;
        exponent += down ? -power : power;
    }
    // Both operands are exact, so the one rounding of the division is the right one (Clinger 1990).
    constexpr std::uint64_t kExact = std::uint64_t{1} << 53;
    if (digits > 0 && digits <= 19 && (q == end || is_blank(*q)) && mantissa <= kExact &&
        exponent >= -22 && exponent <= 22) {
        const auto size = static_cast<double>(mantissa);
        const double result = exponent < 0
                                  ? size / kPowersOfTen[static_cast<std::size_t>(-exponent)]
                                  : size * kPowersOfTen[static_cast<std::size_t>(exponent)];
        if (std::is_same_v<T, double> || rounds_to_float(result)) {
            value = static_cast<T>(negative ? -result : result);
            return q;
        }
    }
    const std::string_view word = word_at(p, end);
    return parse_unusual_real(word, value) ? word.data() + word.size() : nullptr;
}

/// Also `+7` and a whole number with a point or an exponent (`255.0`), as some programs print
/// integers.
template <std::integral T>
const char* parse(const char* p, const char* end, T& value) noexcept {
    const auto [stop, error] = std::from_chars(p, end, value);
    if (error == std::errc() && (stop == end || is_blank(*stop))) return stop;
    double real = 0;
    const char* const real_end = parse(p, end, real);
    const double beyond = std::ldexp(1.0, std::numeric_limits<T>::digits);  // the largest and 1
    if (real_end == nullptr || !(real >= double(std::numeric_limits<T>::min())) ||
        !(real < beyond) || real != std::trunc(real)) {
        return nullptr;
    }
    value = static_cast<T>(real);
    return real_end;
}

}  // namespace ply_number

}  // namespace stipple
