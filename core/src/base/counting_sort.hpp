#pragma once

#include "stipple/point_cloud.hpp"

#include <utility>
#include <vector>

namespace stipple {

/// The middle of a stable counting sort in parallel blocks: takes how many items of each bucket
/// each block has, at `counts[block * buckets + bucket]`, and puts in their place where that block
/// writes them.
/// @return where each bucket begins; one more for the end of the last.
inline std::vector<Index> counts_to_places(std::vector<Index>& counts, std::size_t buckets) {
    std::vector<Index> begin(buckets + 1);
    Index total = 0;
    for (std::size_t bucket = 0; bucket < buckets; ++bucket) {
        begin[bucket] = total;
        for (std::size_t at = bucket; at < counts.size(); at += buckets) {
            total += std::exchange(counts[at], total);
        }
    }
    begin[buckets] = total;
    return begin;
}

}  // namespace stipple
