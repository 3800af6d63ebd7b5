#pragma once

#include "base/parallel_for.hpp"

#include <algorithm>
#include <atomic>
#include <thread>

namespace stipple {

/// As `parallel_for_blocks`, and tells `context` how many of the blocks are done, whenever the
/// calling thread, which works with the others, has done one. For blocks that take about as long as
/// each other.
template <typename Body>
void parallel_for_blocks_with_progress(std::size_t n, std::size_t block, const RunContext& context,
                                       Body&& body) {
    const std::thread::id caller = std::this_thread::get_id();
    std::atomic<std::size_t> done = 0;
    parallel_for_blocks(n, block, context, [&](std::size_t begin, std::size_t end) {
        body(begin, end);
        const std::size_t sum =
            done.fetch_add(end - begin, std::memory_order_relaxed) + end - begin;
        if (std::this_thread::get_id() == caller)
            context.checkpoint(static_cast<double>(sum) / static_cast<double>(n));
    });
}

/// As `parallel_for_blocks`, and tells `context` when each of up to 16 parts is done, which come
/// one after another: as often for any number of threads. A part has at least 64 blocks, so that
/// threads wait little for each other.
template <typename Body>
void parallel_for_blocks_in_parts(std::size_t n, std::size_t block, const RunContext& context,
                                  Body&& body) {
    constexpr std::size_t kParts = 16, kLeast = 64;
    const std::size_t part = std::max(n / (kParts * block) + 1, kLeast) * block;
    for (std::size_t first = 0; first < n; first += part) {
        const std::size_t last = std::min(n, first + part);
        parallel_for_blocks(last - first, block, context, [&](std::size_t begin, std::size_t end) {
            body(first + begin, first + end);
        });
        context.checkpoint(static_cast<double>(last) / static_cast<double>(n));
    }
}

}  // namespace stipple
