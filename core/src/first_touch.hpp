#pragma once

#include "parallel_for.hpp"

#include <cstddef>

namespace stipple {

/// `values.resize(n)` that stops when asked to: the first touch of new memory, which the system has
/// to clear, takes half a second a GiB.
template <typename Vector>
void resize_in_blocks(Vector& values, std::size_t n, const RunContext& context) {
    values.reserve(n);
    for_blocks_in_order(n, context, [&](std::size_t, std::size_t end) { values.resize(end); });
}

/// A vector of n values made that way.
template <typename Vector>
Vector made_in_blocks(std::size_t n, const RunContext& context) {
    Vector values;
    resize_in_blocks(values, n, context);
    return values;
}

}  // namespace stipple
