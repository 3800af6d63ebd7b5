#include "foot_finder.hpp"

#include "parallel_for.hpp"
#include "plane_kernels.hpp"
#include "quadratic_foot.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

// Eight queries are on their way at once, one in each lane of the vector code. Those near each
// other share a patch: all points within a radius, which holds every neighbourhood that the
// iteration meets; where it does not, the lane gets a patch of its own. What a patch is changes the
// last bits only, and blocks of queries do not share any, so the number of threads changes nothing.

namespace stipple {

namespace {

constexpr std::size_t kLanes = PlaneLanes::kLanes;

/// All points within a radius of some place.
struct Patch {
    Vec3d center = Vec3d::Zero();
    double radius = -1;            ///< infinite where these are all points there are
    double neighborhood = 0;       ///< radius of the k nearest to the center
    Vec3d origin = Vec3d::Zero();  ///< a point of it: what coordinates are relative to
    std::vector<Vec3f> points;     ///< relative to it
    std::size_t number = 0;        ///< tells it from those before it

    bool holds(const Vec3d& place, double reach) const noexcept {
        return (place - center).norm() + reach <= radius;
    }
};

class PatchMaker {
public:
    PatchMaker(std::span<const Vec3f> points, const NeighborSearch& search, unsigned k,
               std::size_t capacity)
        : points_(points), search_(search), k_(k), capacity_(capacity), room_(capacity) {}

    /// About `capacity` points around a place, at least k.
    void make(const Vec3d& place, Patch& patch) {
        const Vec3f at = place.cast<float>();
        std::span<Neighbor> found = near(at);
        const bool all = found.size() == points_.size();
        const auto kth = found.begin() + (k_ - 1);
        std::nth_element(found.begin(), kth, found.end());
        const auto nearest = std::min_element(found.begin(), kth + 1);
        patch.number = ++number_;
        patch.center = at.cast<double>();
        patch.neighborhood = std::sqrt(static_cast<double>(kth->distance_sq));
        patch.radius = all ? std::numeric_limits<double>::infinity() : reach_;
        const Vec3f origin = points_[nearest->index];
        patch.origin = origin.cast<double>();
        patch.points.clear();
        for (const Neighbor& neighbor : found)
            patch.points.push_back(points_[neighbor.index] - origin);
    }

private:
    /// Complete within `reach_`.
    std::span<Neighbor> near(const Vec3f& at) {
        constexpr double kExact = 0.99999;  // for the rounding of distances
        if (guess_ > 0) {
            search_.within(at, static_cast<float>(guess_), within_);
            if (within_.size() >= k_) {
                std::span<Neighbor> found = within_;
                reach_ = guess_ * kExact;
                if (found.size() > capacity_) {
                    const auto last = found.begin() + static_cast<std::ptrdiff_t>(capacity_ - 1);
                    std::nth_element(found.begin(), last, found.end());
                    reach_ = std::sqrt(static_cast<double>(last->distance_sq)) * kExact;
                }
                // So that the next search finds a little less than there is room for.
                guess_ *= std::sqrt(0.9 * static_cast<double>(capacity_) /
                                    static_cast<double>(found.size()));
                return found.first(std::min(found.size(), capacity_));
            }
        }
        const std::span<Neighbor> found = search_.nearest(at, room_);
        reach_ = std::sqrt(static_cast<double>(found.back().distance_sq)) * kExact;
        guess_ = reach_;
        return found;
    }

    std::span<const Vec3f> points_;
    const NeighborSearch& search_;
    std::size_t k_, capacity_;
    std::vector<Neighbor> room_, within_;
    double guess_ = 0, reach_ = 0;
    std::size_t number_ = 0;
};

/// A query on its way.
struct Walker {
    static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

    std::size_t query = kNone;
    Vec3d q, x;
    std::size_t patch = 0;  ///< number of that in the lane
    Vec3d center, origin;
    double radius = 0;
    bool own_patch = false;  ///< made for x just now, so that it holds what it must
    unsigned iteration = 0;
    double last_step = 0, least_step = 0;
    bool near_samples = true;  ///< whether the best foot is where samples are

    Foot best;    ///< of this start
    Foot direct;  ///< of the start from q, while the other goes on
    bool from_sample = false;
    Vec3d sample;              ///< nearest to q
    double sample_radius = 0;  ///< of its neighbourhood
};

class Walk {
public:
    Walk(std::span<const Vec3f> points, const NeighborSearch& search,
         const FootFinder::Options& options, std::span<const Vec3f> queries, std::size_t begin,
         std::size_t end, const std::function<void(std::size_t, const Foot&)>& found)
        : points_(points),
          search_(search),
          options_(options),
          queries_(queries),
          next_(begin),
          end_(end),
          found_(found),
          k_(static_cast<unsigned>(std::min<std::size_t>(options.k, points.size()))),
          lanes_(k_, std::min<std::size_t>(points.size(), 2 * k_ + 8)),
          maker_(points, search, k_, lanes_.candidates.size()),
          quadratic_(points, search, options),
          kernel_(plane_kernel()) {}

    void run() {
        for (std::size_t lane = 0; lane < kLanes; ++lane) begin_query(lane);
        while (busy_ > 0) {
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
        w.from_sample = false;
        constexpr double kSlack = 1.3;  // a neighbourhood grows by 1 to 2 times the way
        if (!shared_.holds(w.q, shared_.neighborhood + (kSlack - 1.0) * (w.q - shared_.center).norm()))
            maker_.make(w.q, shared_);
        if (w.patch != shared_.number) fill(lane, shared_);
        start(lane, w.q);
    }

    void start(std::size_t lane, const Vec3d& x) {
        Walker& w = walkers_[lane];
        w.iteration = 0;
        w.last_step = w.least_step = std::numeric_limits<double>::infinity();
        w.best = {};
        set(lanes_.query, lane, w.q - w.origin);
        place(lane, x);
    }

    void place(std::size_t lane, const Vec3d& x) {
        Walker& w = walkers_[lane];
        w.x = x;
        set(lanes_.place, lane, x - w.origin);
    }

    /// Puts the points of a patch into a lane.
    void fill(std::size_t lane, const Patch& patch) {
        Walker& w = walkers_[lane];
        w.patch = patch.number;
        w.center = patch.center;
        w.origin = patch.origin;
        w.radius = patch.radius;
        for (std::size_t j = 0; j < lanes_.candidates.size(); ++j) {
            PlaneLanes::Row& row = lanes_.candidates[j];
            const Vec3f p = j < patch.points.size() ? patch.points[j]
                                                    : Vec3f::Constant(PlaneLanes::kNowhere);
            row.x[lane] = p.x();
            row.y[lane] = p.y();
            row.z[lane] = p.z();
        }
        lanes_.radius_guess_sq[lane] =
            static_cast<float>(patch.neighborhood * patch.neighborhood);
        set(lanes_.query, lane, w.q - w.origin);
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
        if (w.from_sample && w.iteration == 0) w.sample_radius = r;
        if (!lanes_.flat[lane]) return finish_start(lane);

        const Vec3d foot = w.origin + get(lanes_.foot, lane);
        const double step = std::sqrt(static_cast<double>(lanes_.step_sq[lane]));
        const double h = r / 3.0;
        if (step < w.least_step) {
            w.least_step = step;
            w.best.point = foot;
            w.best.normal = get(lanes_.normal, lane);
            w.best.distance = std::abs(static_cast<double>(lanes_.height[lane]));
            w.best.h = h;
            w.near_samples = lanes_.nearest_sq[lane] <= 0.25F * lanes_.radius_sq[lane];
        }
        // Steps along the surface shrink by about the same factor each time, which the first step,
        // across it, does not tell; but normals turn by no more than about 2 / h. What the steps
        // would still add up to counts.
        const double shrinking = std::max(step / w.last_step, 2.0 * w.best.distance / h);
        w.best.converged =
            step <= options_.tolerance * h ||
            (shrinking < 0.5 && step * shrinking <= options_.tolerance * h * (1.0 - shrinking));
        w.last_step = step;
        if (w.best.converged || ++w.iteration == options_.max_iterations) return finish_start(lane);
        place(lane, foot);
    }

    void finish_start(std::size_t lane) {
        Walker& w = walkers_[lane];
        if (!w.from_sample) {
            constexpr double kNear = 0.25;  // of h: the start from the sample would end here too
            if (w.best.converged && w.best.distance <= kNear * w.best.h && w.near_samples)
                return emit(lane, w.best);
            std::array<Neighbor, 1> room;
            w.sample = points_[search_.nearest(w.q.cast<float>(), room).front().index].cast<double>();
            w.direct = w.best;
            w.from_sample = true;
            w.sample_radius = 0;
            return start(lane, w.sample);
        }
        emit(lane, better(w));
    }

    /// The nearer of two feet, and no nearer than samples allow.
    static Foot better(const Walker& w) {
        const double to_sample = (w.q - w.sample).norm();
        const bool either = w.direct.converged == w.best.converged
                                ? w.direct.distance <= w.best.distance
                                : w.direct.converged;
        Foot foot = either ? w.direct : w.best;
        if (foot.h == 0 || (!foot.converged && foot.distance > to_sample)) {
            foot.point = w.sample;
            foot.distance = to_sample;
        }
        foot.beyond = foot.distance < to_sample - w.sample_radius;
        if (foot.beyond) foot.distance = to_sample - w.sample_radius;
        return foot;
    }

    void emit(std::size_t lane, const Foot& foot) {
        const Walker& w = walkers_[lane];
        found_(w.query, options_.degree == 2 ? quadratic_.find(w.q, foot) : foot);
        begin_query(lane);
    }

    static void set(PlaneLanes::Row& row, std::size_t lane, const Vec3d& v) {
        row.x[lane] = static_cast<float>(v.x());
        row.y[lane] = static_cast<float>(v.y());
        row.z[lane] = static_cast<float>(v.z());
    }
    static Vec3d get(const PlaneLanes::Row& row, std::size_t lane) {
        return {row.x[lane], row.y[lane], row.z[lane]};
    }

    std::span<const Vec3f> points_;
    const NeighborSearch& search_;
    const FootFinder::Options& options_;
    std::span<const Vec3f> queries_;
    std::size_t next_, end_;
    const std::function<void(std::size_t, const Foot&)>& found_;
    unsigned k_;
    PlaneLanes lanes_;
    PatchMaker maker_;
    QuadraticFoot quadratic_;
    PlaneKernel kernel_;
    Patch shared_, own_;
    std::array<Walker, kLanes> walkers_;
    std::size_t busy_ = 0;
};

}  // namespace

FootFinder::FootFinder(std::span<const Vec3f> points, const NeighborSearch& search,
                       const Options& options)
    : points_(points), search_(search), options_(options) {}

void FootFinder::find(std::span<const Vec3f> queries,
                      const std::function<void(std::size_t, const Foot&)>& found,
                      const RunContext& context) const {
    constexpr std::size_t kBlock = 2048;
    parallel_for_blocks(queries.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        Walk(points_, search_, options_, queries, begin, end, found).run();
    });
}

}  // namespace stipple
