#pragma once

#include "clustering/point_blocks.hpp"
#include "stipple/point_cloud.hpp"

#include <cstddef>
#include <limits>
#include <vector>

namespace stipple {

/// What lies within some distance of places that are looked from one after another, each seldom far
/// from the one before.
class Surroundings {
public:
    /// Blocks that are not all in the samples `begin..end` are not looked at, but noticed.
    explicit Surroundings(Index begin = 0, Index end = std::numeric_limits<Index>::max())
        : begin_(begin), end_(end) {}

    /// Finds the squared distances of all points within `counted` of q, and the free ones within
    /// `radius`, which is no less. @return whether these are no more than `limit`, and perhaps
    /// eight blocks; if they are more, not all of them are here.
    bool look(const PointBlocks& blocks, const Vec3f& q, float counted, float radius,
              std::size_t limit);

    /// Whether blocks that are not looked at were near, of any look since this was made false.
    bool is_beyond = false;

    // Of the last look; eight more stand behind, which are infinitely far.
    std::vector<float> all_sq;   ///< squared distances of the points counted
    std::vector<float> free_sq;  ///< and of the free ones,
    std::vector<Index> free;     ///< which are here
    std::size_t all_count = 0, free_count = 0;

private:
    void make_room(std::size_t count);

    Index begin_, end_;
    PointBlocks::Vicinity vicinity_;
};

}  // namespace stipple
