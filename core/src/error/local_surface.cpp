#include "error/local_surface.hpp"

#include "base/random.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace stipple {

namespace {

/// Of how many points one says how dense the cloud is.
std::size_t stride_for(std::size_t n) noexcept {
    constexpr std::size_t kMany = 1U << 17U;
    return n < kMany ? 8 : 16;
}

/// One point of each stretch of so many, none by a rhythm that scan lines may have too.
std::vector<Index> one_of_each(std::size_t stride, std::size_t n) {
    std::vector<Index> some;
    some.reserve(n / stride);
    for (std::size_t begin = 0; begin + stride <= n; begin += stride)
        some.push_back(static_cast<Index>(begin + random_bits(0, begin) % stride));
    return some;
}

/// Whether all neighbours of a foot are within a ball, as far as the surface is flat there.
bool holds(const Ball& ball, const Foot& foot) {
    constexpr double kExact = 0.999;
    const double r = foot.radius, R = kExact * ball.radius;
    return (foot.point - ball.center.cast<double>()).squaredNorm() + r * r <= R * R;
}

}  // namespace

LocalSurface::LocalSurface(const BoxedCloud& cloud, const ErrorFrame& frame, std::size_t places,
                           const FootFinder::Options& options, const RunContext& context)
    : cloud_(cloud), frame_(frame), options_(options) {
    const std::size_t n = size(), stride = stride_for(n);
    constexpr std::size_t kFew = 100'000;  // isolated ones may stand for most of the area
    const bool whole = n <= std::max(kFew, 2 * kForFeet * places);
    some_ = std::make_shared<Part>(whole ? frame.into(cloud.cloud, context)
                                         : frame.into(cloud.cloud, one_of_each(stride, n), context),
                                   leaves_for(whole ? n : n / stride, places), options, context);
}

std::vector<Ball> LocalSurface::views(std::span<const Vec3f> places, std::size_t points,
                                      const RunContext& context) const {
    std::vector<Ball> balls(places.size());
    constexpr std::size_t kBlock = 512;
    parallel_for_blocks(places.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        std::vector<Neighbor> room(std::max<std::size_t>(1, points / stride_for(size())));
        for (std::size_t i = begin; i < end; ++i) {
            balls[i].center = places[i];
            if (is_whole()) continue;
            const auto nearest = find_nearest(some_->tree, places[i], room);
            balls[i].radius = std::sqrt(nearest.back().distance_sq);
        }
    });
    return balls;
}

std::shared_ptr<const LocalSurface::Part> LocalSurface::gather(std::span<const Ball> balls,
                                                               const RunContext& context) const {
    if (is_whole()) return some_;
    const PointCloud& cloud = cloud_.cloud;
    std::vector<Ball> of_cloud;
    of_cloud.reserve(balls.size());
    for (const Ball& ball : balls) {
        // What floats round away, here and in the frame: rather too many points.
        constexpr float kRounding = 0x1p-20F;
        const auto per_unit = static_cast<float>(1 / frame_.scale);
        const Vec3f center = frame_.out_of(ball.center, cloud);
        const float farthest =
            std::max(center.cwiseAbs().maxCoeff(), per_unit * ball.center.cwiseAbs().maxCoeff());
        const float radius = per_unit * ball.radius;
        of_cloud.push_back({center, radius + kRounding * (farthest + radius)});
    }
    const Vec3f low = (cloud_.box.min - cloud.origin).cast<float>();
    const auto diagonal = static_cast<float>(cloud_.box.diagonal());
    const std::vector<Index> near =
        points_within(of_cloud, cloud.positions, low, diagonal, context);
    return std::make_shared<Part>(frame_.into(cloud, near, context),
                                  leaves_for(near.size(), balls.size()), options_, context);
}

void LocalSurface::find(const Part& part, std::span<const Ball> places,
                        const std::function<void(std::size_t, const Foot&)>& found,
                        const RunContext& context) const {
    constexpr unsigned kRounds = 3;
    std::vector<Foot> feet(places.size());
    std::vector<std::size_t> open(places.size());
    std::iota(open.begin(), open.end(), std::size_t{0});
    std::vector<Ball> balls(places.begin(), places.end());
    std::size_t of_each = 1;
    std::shared_ptr<const Part> more;
    for (unsigned round = 1; !open.empty(); ++round) {
        std::vector<Vec3f> asked;
        for (const std::size_t i : open) asked.push_back(places[i].center);
        (more ? *more : part)
            .finder.find(
                asked, [&](std::size_t j, const Foot& foot) { feet[open[j]] = foot; }, context);
        if (is_whole() || round == kRounds) break;
        std::vector<std::size_t> still_open;
        std::vector<Ball> larger;
        for (std::size_t j = 0; j < open.size(); ++j) {
            const auto own = std::span(balls).subspan(j * of_each, of_each);
            const Foot& foot = feet[open[j]];
            if (std::ranges::any_of(own, [&](const Ball& ball) { return holds(ball, foot); }))
                continue;
            const Ball wider = {asked[j], 2 * own.front().radius};
            const Ball beside = {foot.point.cast<float>(), static_cast<float>(2 * foot.radius)};
            const bool is_near = (beside.center - wider.center).norm() <= 2 * wider.radius;
            still_open.push_back(open[j]);
            larger.push_back(wider);
            larger.push_back(is_near ? beside : wider);
        }
        if (still_open.empty()) break;
        open = std::move(still_open);
        balls = std::move(larger);
        of_each = 2;
        more = gather(balls, context);
    }
    for (std::size_t i = 0; i < feet.size(); ++i) found(i, feet[i]);
}

}  // namespace stipple
