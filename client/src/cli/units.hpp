#pragma once

#include "stipple/proto/thousands.hpp"

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace stipple::cli {

/// `0.0123`, `1.5e+04`: three digits.
std::string three_digits(double value);
/// `0.0011`: how sure another number is.
std::string two_digits(double value);
using proto::with_separators;
/// `1 point`, `1,000 points`: plurals by an `s`, or as given.
std::string counted(std::uint64_t count, const std::string& one, const std::string& many = {});
/// `a, b, c` with a separator of `, `.
std::string joined(const std::vector<std::string>& parts, std::string_view separator);
/// `310 B`, `60 kB`, `10.4 MB`: three digits at most, powers of 1000.
std::string readable_bytes(std::uint64_t bytes);
/// `0.4 ms`, `42 ms`, `1.8 s`, `12 s`, `3 min 20 s`, `2 h 5 min`.
std::string readable_seconds(double seconds);
/// `part` of `whole`: `1.1 %`, `25 %`, `<0.1 %`.
std::string readable_share(std::uint64_t part, std::uint64_t whole);

/// `text` in so many columns, to the left or to the right of them.
std::string in_left(const std::string& text, std::size_t columns);
std::string in_right(const std::string& text, std::size_t columns);

}  // namespace stipple::cli
