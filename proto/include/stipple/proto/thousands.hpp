#pragma once

#include <cstdint>
#include <string>

namespace stipple::proto {

/// 435545 as `435,545`.
std::string with_separators(std::uint64_t count);

}  // namespace stipple::proto
