#include "clustering/surroundings.hpp"

#include <algorithm>

namespace stipple {

bool Surroundings::look(const PointBlocks& blocks, const Vec3f& q, float counted, float radius,
                        std::size_t limit) {
    blocks.approach(q, radius, vicinity_);
    make_room(vicinity_.sample_count + PointBlocks::kSlack);
    const NearbyQuery query = {
        {q.x(), q.y(), q.z()}, counted * counted, radius * radius, begin_, end_, limit};
    const NearbyOutput out =
        cluster_kernels().nearby(blocks.view(), vicinity_.groups.data(), vicinity_.groups.size(),
                                 query, {all_sq.data(), free_sq.data(), free.data()});
    all_count = static_cast<std::size_t>(out.all_sq - all_sq.data());
    free_count = static_cast<std::size_t>(out.free_sq - free_sq.data());
    is_beyond |= out.is_beyond;
    constexpr float kFar = std::numeric_limits<float>::infinity();
    std::fill_n(out.all_sq, PointBlocks::kSlack, kFar);
    std::fill_n(out.free_sq, PointBlocks::kSlack, kFar);
    return all_count + free_count <= limit;
}

void Surroundings::make_room(std::size_t count) {
    if (count <= all_sq.size()) return;
    all_sq.resize(2 * count);
    free_sq.resize(2 * count);
    free.resize(2 * count);
}

}  // namespace stipple
