#include "foot_finder.hpp"

#include "nearby_search.hpp"
#include "parallel_for.hpp"
#include "plane_kernels.hpp"
#include "quadratic_foot.hpp"
#include "tree_search.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

// Eight queries are on their way at once, one in each lane of the vector code. Those near each
// other share a patch: all points within a radius, which holds every neighbourhood that the
// iteration meets; where it does not, the lane gets a patch of its own. What a patch is changes the
// last bits only, and blocks of queries do not share any, so the number of threads changes nothing.

namespace stipple {

namespace {

constexpr std::size_t kLanes = PlaneLanes::kLanes;
constexpr double kReaching = 20;  // the surface reaches as far as so many points around a sample

/// All points within a radius of some place.
struct Patch {
    Vec3d center = Vec3d::Zero();
    double radius = -1;            ///< infinite where these are all points there are
    double neighborhood = 0;       ///< about the radius of the k nearest to the center
    Vec3d origin = Vec3d::Zero();  ///< a point of it: what coordinates are relative to
    std::vector<Vec3f> points;     ///< relative to it
    std::size_t number = 0;        ///< tells it from those before it

    /// Whether the neighbourhood of a place is probably within it: its radius is at most that
    /// around the center and all of the way, and mostly much less.
    bool holds(const Vec3d& place) const noexcept {
        constexpr double kLonger = 1.3;
        return neighborhood + kLonger * (place - center).norm() <= radius;
    }
};

/// Makes the patches of one thread.
class PatchMaker {
public:
    PatchMaker(std::span<const Vec3f> points, const PointTree& tree, unsigned k, std::size_t room)
        : points_(points), k_(k), search_(tree, k, room) {}

    void make(const Vec3d& place, Patch& patch) {
        const Vec3f at = place.cast<float>();
        set(at, search_.find(at), patch);
    }
    /// Where points are about as near and dense as around the last place; else false.
    bool make_near(const Vec3d& place, Patch& patch) {
        const Vec3f at = place.cast<float>();
        const std::span<const Neighbor> found = search_.find_near(at);
        if (!found.empty()) set(at, found, patch);
        return !found.empty();
    }

private:
    void set(const Vec3f& at, std::span<const Neighbor> found, Patch& patch) {
        Neighbor nearest = found.front();
        float farthest_sq = 0;
        for (const Neighbor& neighbor : found) {
            farthest_sq = std::max(farthest_sq, neighbor.distance_sq);
            if (neighbor.distance_sq <= nearest.distance_sq && neighbor < nearest)
                nearest = neighbor;
        }
        const Vec3f origin = points_[nearest.index];
        patch.number = ++number_;
        patch.center = at.cast<double>();
        patch.radius = search_.reach();
        const double size = static_cast<double>(found.size());
        patch.neighborhood = std::sqrt(static_cast<double>(farthest_sq) * k_ / size);
        patch.origin = origin.cast<double>();
        patch.points.clear();
        for (const Neighbor& neighbor : found)
            patch.points.push_back(points_[neighbor.index] - origin);
    }

    std::span<const Vec3f> points_;
    unsigned k_;
    NearbySearch search_;
    std::size_t number_ = 0;
};

/// A query on its way.
struct Walker {
    static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

    std::size_t query = kNone;
    Vec3d q, x;
    std::size_t patch = 0, patch_size = 0;  ///< number and size of that in the lane
    Vec3d center, origin;
    double radius = 0;
    bool own_patch = false;  ///< made for x just now, so that it holds what it must
    unsigned iteration = 0;
    double last_step = 0, least_step = 0;
    Vec3d earlier = Vec3d::Zero();  ///< where it was some steps ago

    Foot best;    ///< of this start
    Foot direct;  ///< of the start from q, while the other goes on
    bool from_sample = false;
    double to_sample = 0;     ///< from q to the nearest sample
    Vec3d sample;             ///< that one
    double sample_reach = 0;  ///< how far from it the surface may be
    double off_surface = 0;   ///< how far it is from the plane of its own neighbourhood
};

class Walk {
public:
    Walk(std::span<const Vec3f> points, const PointTree& tree, const FootFinder::Options& options,
         std::span<const Vec3f> queries, std::size_t begin, std::size_t end,
         const std::function<void(std::size_t, const Foot&)>& found)
        : points_(points),
          tree_(tree),
          options_(options),
          queries_(queries),
          next_(begin),
          end_(end),
          found_(found),
          k_(static_cast<unsigned>(std::min<std::size_t>(options.k, points.size()))),
          lanes_(k_, std::min<std::size_t>(points.size(), 2 * k_ + 8)),
          reach_(std::sqrt(std::max(1.0, kReaching / k_))),
          maker_(points, tree, k_, lanes_.candidates.size()),
          quadratic_(points, tree, options),
          kernel_(plane_kernel()) {}

    void run(const RunContext& context) {
        for (std::size_t lane = 0; lane < kLanes; ++lane) begin_query(lane);
        unsigned rounds = 0;
        while (busy_ > 0) {
            constexpr unsigned kRoundsBetween = 64;
            if (++rounds % kRoundsBetween == 0) context.throw_if_stopped();
            kernel_.run(lanes_);
            for (std::size_t lane = 0; lane < kLanes; ++lane) {
                if (walkers_[lane].query != Walker::kNone) advance(lane);
            }
        }
    }

private:
    void begin_query(std::size_t lane) {
        Walker& w = walkers_[lane];
        if (w.query != Walker::kNone) --busy_;
        w.query = Walker::kNone;
        if (next_ == end_) return;
        ++busy_;
        w.query = next_++;
        w.q = queries_[w.query].cast<double>();
        w.direct = {};
        w.from_sample = !shared_.holds(w.q) && !maker_.make_near(w.q, shared_);
        if (w.from_sample) {
            find_sample(w);
            maker_.make(w.sample, shared_);
            w.from_sample = w.to_sample > reach_ * shared_.neighborhood;
        }
        if (w.patch != shared_.number) fill(lane, shared_);
        start(lane, w.from_sample ? w.sample : w.q);
    }

    void find_sample(Walker& w) const {
        Neighbor nearest;
        find_nearest(tree_, w.q.cast<float>(), {&nearest, 1});
        w.sample = points_[nearest.index].cast<double>();
        w.to_sample = (w.q - w.sample).norm();
    }

    void start(std::size_t lane, const Vec3d& x) {
        Walker& w = walkers_[lane];
        w.iteration = 0;
        w.sample_reach = w.off_surface = 0;
        w.last_step = w.least_step = std::numeric_limits<double>::infinity();
        w.best = {};
        w.earlier = x;
        set(lanes_.query, lane, (w.q - w.origin).cast<float>());
        place(lane, x);
    }

    void place(std::size_t lane, const Vec3d& x) {
        Walker& w = walkers_[lane];
        w.x = x;
        set(lanes_.place, lane, (x - w.origin).cast<float>());
    }

    /// Puts the points of a patch into a lane.
    void fill(std::size_t lane, const Patch& patch) {
        Walker& w = walkers_[lane];
        w.patch = patch.number;
        w.center = patch.center;
        w.origin = patch.origin;
        w.radius = patch.radius;
        const std::size_t before = std::exchange(w.patch_size, patch.points.size());
        lanes_.rows = 0;
        for (const Walker& other : walkers_) lanes_.rows = std::max(lanes_.rows, other.patch_size);
        for (std::size_t j = 0; j < w.patch_size; ++j)
            set(lanes_.candidates[j], lane, patch.points[j]);
        for (std::size_t j = w.patch_size; j < before; ++j)
            set(lanes_.candidates[j], lane, Vec3f::Constant(PlaneLanes::kNowhere));
        lanes_.radius_guess_sq[lane] = static_cast<float>(patch.neighborhood * patch.neighborhood);
        set(lanes_.query, lane, (w.q - w.origin).cast<float>());
    }

    void advance(std::size_t lane) {
        Walker& w = walkers_[lane];
        const double r = std::sqrt(static_cast<double>(lanes_.radius_sq[lane]));
        if (!w.own_patch && (w.x - w.center).norm() + r > w.radius) {
            maker_.make(w.x, own_);
            fill(lane, own_);
            w.own_patch = true;
            return place(lane, w.x);
        }
        w.own_patch = false;
        lanes_.radius_guess_sq[lane] = lanes_.radius_sq[lane];
        if (w.iteration == 0) {
            if (w.from_sample)
                w.sample_reach = r * reach_;
            else
                w.to_sample = std::sqrt(static_cast<double>(lanes_.nearest_sq[lane]));
        }
        // There is no surface where there are no samples.
        const double nearness = lanes_.nearest_sq[lane] / lanes_.radius_sq[lane];
        constexpr double kLost = 0.5;
        if (!lanes_.flat[lane] || (w.iteration > 0 && nearness > kLost)) return finish_start(lane);

        const Vec3d foot = w.origin + get(lanes_.foot, lane);
        const double step = std::sqrt(static_cast<double>(lanes_.step_sq[lane]));
        const double h = r / 3.0;
        if (options_.across_sample && w.from_sample && w.iteration == 0)
            w.off_surface = std::abs(static_cast<double>(lanes_.height[lane]) -
                                     get(lanes_.normal, lane).dot(w.q - w.sample));
        if (step < w.least_step) {
            w.least_step = step;
            w.best.point = foot;
            w.best.normal = get(lanes_.normal, lane);
            w.best.distance = std::abs(static_cast<double>(lanes_.height[lane]));
            w.best.h = h;
            w.best.off_center =
                3 * std::sqrt(static_cast<double>(lanes_.offset_sq[lane] / lanes_.radius_sq[lane]));
            w.best.emptiness = std::sqrt(nearness);
            w.best.roundness = static_cast<double>(lanes_.roundness[lane]);
        }
        // Steps along the surface shrink by about the same factor each time, which the first step,
        // across it, does not tell; but normals turn by no more than about 2 / h. What the steps
        // would still add up to counts.
        const double shrinking = std::max(step / w.last_step, 2.0 * w.best.distance / h);
        w.best.converged =
            step <= options_.tolerance * h ||
            (shrinking < 0.5 && step * shrinking <= options_.tolerance * h * (1.0 - shrinking));
        w.last_step = step;
        if (w.best.converged || ++w.iteration == options_.max_iterations ||
            goes_round(w, foot, step, h))
            return finish_start(lane);
        place(lane, foot);
    }

    /// Whether long steps have led back to where the walk was before, as they will again (R. Brent
    /// 1980: compared with places that are remembered for twice as long each time).
    bool goes_round(Walker& w, const Vec3d& foot, double step, double h) const {
        constexpr double kLong = 30;
        const double near = options_.tolerance * h;
        if (step > kLong * near && (foot - w.earlier).squaredNorm() <= near * near) return true;
        if (std::has_single_bit(w.iteration)) w.earlier = foot;
        return false;
    }

    void finish_start(std::size_t lane) {
        Walker& w = walkers_[lane];
        if (!w.from_sample) {
            constexpr double kNear = 0.25;  // of h: the start from the sample would end here too
            if (w.best.distance <= kNear * w.best.h && w.best.on_surface())
                return emit(lane, w.best);
            find_sample(w);
            w.direct = w.best;
            w.from_sample = true;
            return start(lane, w.sample);
        }
        emit(lane, better(w));
    }

    /// The nearer of two feet, and no nearer than samples allow.
    static Foot better(const Walker& w) {
        const bool direct =
            w.direct.h > 0 && w.to_sample <= w.sample_reach &&
            (w.direct.converged == w.best.converged ? w.direct.distance <= w.best.distance
                                                    : w.direct.converged);
        Foot foot = direct ? w.direct : w.best;
        const double by_sample = w.to_sample + w.off_surface;
        if (foot.h == 0 || (!foot.converged && foot.distance > by_sample)) {
            foot.point = w.sample;
            foot.distance = by_sample;
        }
        foot.beyond = foot.distance < w.to_sample - w.sample_reach;
        if (foot.beyond) foot.distance = w.to_sample - w.sample_reach;
        return foot;
    }

    void emit(std::size_t lane, Foot foot) {
        const Walker& w = walkers_[lane];
        if (options_.degree == 2) foot = quadratic_.find(w.q, foot);
        foot.to_sample = w.to_sample;
        found_(w.query, foot);
        begin_query(lane);
    }

    static void set(PlaneLanes::Row& row, std::size_t lane, const Vec3f& v) {
        row.x[lane] = v.x();
        row.y[lane] = v.y();
        row.z[lane] = v.z();
    }
    static Vec3d get(const PlaneLanes::Row& row, std::size_t lane) {
        return {row.x[lane], row.y[lane], row.z[lane]};
    }

    std::span<const Vec3f> points_;
    const PointTree& tree_;
    const FootFinder::Options& options_;
    std::span<const Vec3f> queries_;
    std::size_t next_, end_;
    const std::function<void(std::size_t, const Foot&)>& found_;
    unsigned k_;
    PlaneLanes lanes_;
    double reach_;  ///< of the surface around a sample, over the radius of its neighbourhood
    PatchMaker maker_;
    QuadraticFoot quadratic_;
    PlaneKernel kernel_;
    Patch shared_, own_;
    std::array<Walker, kLanes> walkers_;
    std::size_t busy_ = 0;
};

}  // namespace

FootFinder::FootFinder(std::span<const Vec3f> points, const PointTree& tree, const Options& options)
    : points_(points), tree_(tree), options_(options) {}

Vec3f FootFinder::nearest_sample(const Vec3f& place) const {
    Neighbor nearest;
    find_nearest(tree_, place, {&nearest, 1});
    return points_[nearest.index];
}

void FootFinder::find(std::span<const Vec3f> queries,
                      const std::function<void(std::size_t, const Foot&)>& found,
                      const RunContext& context) const {
    constexpr std::size_t kLeast = 128, kMost = 2048, kBlocks = 32;
    const std::size_t block = std::clamp(queries.size() / kBlocks, kLeast, kMost);
    parallel_for_blocks(queries.size(), block, context, [&](std::size_t begin, std::size_t end) {
        Walk(points_, tree_, options_, queries, begin, end, found).run(context);
    });
}

}  // namespace stipple
