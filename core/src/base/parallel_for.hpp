#pragma once

#include "stipple/run_context.hpp"

#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

namespace stipple {

/// Runs `work` where TBB uses the threads of `context`, also when those are more than the machine
/// has. Where it does so already, in an outer call, nothing is set up anew.
template <typename Work>
void with_threads(const RunContext& context, Work&& work) {
    const auto threads = static_cast<int>(context.thread_count());
    if (threads == 1 || tbb::this_task_arena::max_concurrency() == threads) return work();
    // The arena is what limits this call; the control only allows more, and is of the whole
    // process.
    constexpr auto kAllowed = tbb::global_control::max_allowed_parallelism;
    std::optional<tbb::global_control> more;
    if (tbb::global_control::active_value(kAllowed) < static_cast<std::size_t>(threads))
        more.emplace(kAllowed, static_cast<std::size_t>(threads));
    tbb::task_arena(threads).execute(std::forward<Work>(work));
}

/// Calls `body(begin, end)` for the blocks of `block` indices that make up 0..n, on the threads of
/// `context`. The blocks depend on `n` and `block` alone, so what a body sums up over its block
/// does not depend on the number of threads. Throws what a body throws, and `Cancelled` between
/// blocks when asked to stop.
template <typename Body>
void parallel_for_blocks(std::size_t n, std::size_t block, const RunContext& context, Body&& body) {
    const std::size_t blocks = (n + block - 1) / block;
    const auto run_block = [&](std::size_t b) {
        context.throw_if_stopped();
        body(b * block, std::min(n, (b + 1) * block));
    };
    if (context.thread_count() == 1 || blocks <= 1) {
        for (std::size_t b = 0; b < blocks; ++b) run_block(b);
        return;
    }
    with_threads(context, [&] {
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks, 1), [&](const auto& range) {
            for (std::size_t b = range.begin(); b != range.end(); ++b) run_block(b);
        });
    });
}

/// Calls `body(begin, end)` for blocks of 0..n one after the other, on the calling thread: for what
/// has to be done in order, and still has to stop when asked to.
template <typename Body>
void for_blocks_in_order(std::size_t n, const RunContext& context, Body&& body) {
    constexpr std::size_t kBlock = std::size_t{1} << 16U;
    for (std::size_t begin = 0; begin < n; begin += kBlock) {
        context.throw_if_stopped();
        body(begin, std::min(n, begin + kBlock));
    }
}

}  // namespace stipple
