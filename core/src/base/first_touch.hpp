#pragma once

#include "base/large_memory.hpp"
#include "base/parallel_for.hpp"

#include <cstddef>

namespace stipple {

/// Grows to n values, and stops when asked to: the first touch of new memory, which the system has
/// to clear, takes half a second a GiB in small pages.
template <typename Vector>
void resize_in_blocks(Vector& values, std::size_t n, const RunContext& context) {
    values.reserve(n);
    prefer_huge_pages(values.data(), n * sizeof(values[0]));
    for_blocks_in_order(n, context, [&](std::size_t, std::size_t end) { values.resize(end); });
}

/// `values.resize(n)` of an empty vector, in huge pages where that is worth it.
template <typename Vector>
void resize_in_huge_pages(Vector& values, std::size_t n) {
    values.reserve(n);
    prefer_huge_pages(values.data(), n * sizeof(values[0]));
    values.resize(n);
}

/// `values.reserve(n)` that stops when asked to.
template <typename Vector>
void reserve_in_blocks(Vector& values, std::size_t n, const RunContext& context) {
    if (n <= values.capacity()) return;
    Vector larger(values.get_allocator());
    larger.reserve(n);
    prefer_huge_pages(larger.data(), n * sizeof(larger[0]));
    for_blocks_in_order(values.size(), context, [&](std::size_t begin, std::size_t end) {
        larger.insert(larger.end(), values.begin() + static_cast<std::ptrdiff_t>(begin),
                      values.begin() + static_cast<std::ptrdiff_t>(end));
    });
    values.swap(larger);
}

/// `values.resize(n)`, which gives back the pages of the others; the capacity stays.
template <typename Vector>
void cut_off(Vector& values, std::size_t n) {
    const std::size_t others = values.size() - n;
    values.resize(n);
    return_pages(values.data() + n, others * sizeof(values[0]));
}

/// A vector of n values, made as by `resize_in_blocks`.
template <typename Vector>
Vector made_in_blocks(std::size_t n, const RunContext& context) {
    Vector values;
    resize_in_blocks(values, n, context);
    return values;
}

}  // namespace stipple
