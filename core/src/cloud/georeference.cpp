#include "cloud/georeference.hpp"

#include "base/in_words.hpp"
#include "cloud/box_of_most.hpp"
#include "stipple/error.hpp"

#include <cmath>
#include <limits>
#include <utility>

namespace stipple {

Vec3d choose_origin(const Aabb& all, std::vector<Vec3d> some) {
    if (all.empty()) return Vec3d::Zero();
    double side = longest_side(all);
    constexpr double kLongestSide = 1e37;
    if (!(side <= kLongestSide)) {
        throw Error(
            ErrorCode::MalformedInput,
            in_words("the coordinates spread over ", side, ": expected at most ", kLongestSide,
                     ", the range of single precision; remove far-off points, or give them "
                     "in a larger unit"));
    }
    constexpr double kShortestSide = std::numeric_limits<float>::min();
    if (side > 0 && side < kShortestSide) {
        throw Error(
            ErrorCode::MalformedInput,
            in_words("the coordinates spread over ", side, ": expected at least ", kShortestSide,
                     ", the least of single precision, or a single place; give them in a "
                     "smaller unit"));
    }
    constexpr double kFarOff = 64;
    const Aabb most = box_of_most(std::move(some));
    const bool few_far_off = longest_side(most) > 0 && side > kFarOff * longest_side(most);
    const Aabb& box = few_far_off ? most : all;
    side = longest_side(box);
    const Vec3d center = 0.5 * box.min + 0.5 * box.max;
    if (side == 0) return center;
    const double grid = std::exp2(std::ceil(std::log2(side)));
    // Two thirds, not a half: boxes like 0..side and -side/2..side/2 are common, and their centres
    // lie on the steps of the usual roundings, where the last bit would decide.
    return ((center / grid).array() + 2.0 / 3.0).floor() * grid;
}

}  // namespace stipple
