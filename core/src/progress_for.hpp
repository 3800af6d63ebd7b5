#pragma once

#include "parallel_for.hpp"

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

}  // namespace stipple
