#include "stipple/proto/thousands.hpp"

namespace stipple::proto {

std::string with_separators(std::uint64_t count) {
    constexpr std::size_t kGroup = 3;
    std::string digits = std::to_string(count);
    for (std::size_t i = digits.size(); i > kGroup; i -= kGroup) digits.insert(i - kGroup, 1, ',');
    return digits;
}

}  // namespace stipple::proto
