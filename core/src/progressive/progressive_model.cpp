#include "progressive/progressive_model.hpp"

#include <algorithm>
#include <cmath>

namespace stipple {

void ProgressiveModel::find_candidates(Index number, const CellNeighbors& neighbors,
                                       const CellTangent& tangent, std::span<const Cell> places,
                                       unsigned lift, std::vector<Candidate>& found) {
    constexpr double kReach = 1.3, kLeastReach = 1.5, kMostReach = 5, kMostSpacing = 8;
    constexpr double kThickness = 0.75, kThicknessOfRough = 1.5;
    constexpr unsigned kLeastNeighbors = 3;
    found.clear();
    const auto side = static_cast<double>(2U << lift);
    const double spacing = tangent.spacing / side;
    if (neighbors.count < kLeastNeighbors || spacing >= kMostSpacing || neighbors.shadow) return;

    const auto& [n, height, roughness, a] = tangent.plane;
    const unsigned b = (a + 1) % 3, c = (a + 2) % 3;
    const double reach = std::clamp(kReach * spacing, kLeastReach, kMostReach) * side;
    const double thickness = kThickness * side + kThicknessOfRough * roughness;
    const auto steps = static_cast<std::int32_t>(std::ceil(reach / side));
    const unsigned spacings = spacing_class(spacing);
    const Cell& from = places[number];
    // The way to the middle of the cell in which the point lies.
    std::array<double, 3> own;
    for (int axis = 0; axis < 3; ++axis)
        own[axis] = ((((from[axis] >> (lift + 1)) * 2) + 1) << lift) - from[axis];
    const double reach_sq = reach * reach;
    Candidate candidate{.middle = {}, .plane = tangent.plane, .context = 0};
    for (std::int32_t u = -steps; u <= steps; ++u) {
        const double x = own[b] + side * u;
        for (std::int32_t v = -steps; v <= steps; ++v) {
            const double y = own[c] + side * v;
            if (x * x + y * y > reach_sq) continue;
            const double along = n[b] * x + n[c] * y - height;
            const double one = (-thickness - along) / n[a], other = (thickness - along) / n[a];
            const double low = std::ceil((std::min(one, other) - own[a]) / side);
            const double high = std::floor((std::max(one, other) - own[a]) / side);
            const auto last = static_cast<std::int32_t>(std::min<double>(high, steps));
            for (auto w = static_cast<std::int32_t>(std::max<double>(low, -steps)); w <= last;
                 ++w) {
                const double z = own[a] + side * w;
                const double d = x * x + y * y + z * z;
                if (d > reach_sq) continue;
                candidate.middle[a] = from[a] + static_cast<std::int32_t>(z);
                candidate.middle[b] = from[b] + static_cast<std::int32_t>(x);
                candidate.middle[c] = from[c] + static_cast<std::int32_t>(y);
                const bool nearer_to_another = std::ranges::any_of(neighbors.list(), [&](Index i) {
                    const auto e = static_cast<double>(distance_sq(places[i], candidate.middle));
                    return e < d || (e == d && i < number);
                });
                if (nearer_to_another) continue;
                const double off = n[a] * z + along;
                const unsigned far = bin(8 * std::sqrt(d) / tangent.spacing, kDistances);
                const unsigned over = bin(6 * std::abs(off) / side, kHeights);
                candidate.plane.offset = -off;
                candidate.context =
                    static_cast<std::uint16_t>((spacings * kDistances + far) * kHeights + over);
                found.push_back(candidate);
            }
        }
    }
}

}  // namespace stipple
