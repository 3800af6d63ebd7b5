#include "stipple/proto/idempotency_key.hpp"

#include "stipple/error.hpp"

#include <algorithm>
#include <cstddef>
#include <string>

namespace stipple::proto {

void check_idempotency_key(std::string_view key) {
    constexpr std::size_t kLongest = 255;
    const bool printable = std::ranges::all_of(key, [](char c) { return ' ' <= c && c <= '~'; });
    if (!key.empty() && key.size() <= kLongest && printable) return;
    throw Error(ErrorCode::InvalidArgument, "idempotency key of " + std::to_string(key.size()) +
                                                " bytes: expected 1.." + std::to_string(kLongest) +
                                                " printable ASCII characters");
}

}  // namespace stipple::proto
