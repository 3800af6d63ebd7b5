#pragma once

#include "stipple/run_context.hpp"

#include <cstddef>

namespace stipple {

/// An order for an algorithm of the standard library that is to end with `Cancelled` when asked to
/// stop: what it was putting in order is then in none. The context must outlive it.
template <typename Less>
auto until_stopped(const RunContext& context, Less less) {
    constexpr std::size_t kBetween = std::size_t{1} << 16U;
    return [&context, less, calls = std::size_t{0}](const auto& a, const auto& b) mutable {
        if (++calls % kBetween == 0) context.throw_if_stopped();
        return less(a, b);
    };
}

}  // namespace stipple
