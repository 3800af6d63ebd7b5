#include "error/foot_finder.hpp"

#include "analysis/planar_hull.hpp"
#include "base/parallel_for.hpp"
#include "error/line_foot.hpp"
#include "error/plane_kernels.hpp"
#include "error/quadratic_foot.hpp"
#include "neighbors/nearest_kernels.hpp"
#include "neighbors/tree_search.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
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
    double radius = -1;         ///< infinite where these are all points there are
    double neighborhood = 0;    ///< about the radius of the k nearest to the center
    std::vector<float> points;  ///< relative to it: all x, all y and all z, with room for as many
    std::size_t size = 0;
    unsigned uses = 0;  ///< by walkers, or as what the next may share

    /// Whether the neighbourhood of a place is probably within it: its radius is at most that
    /// around the center and all of the way, and mostly much less.
    bool holds(const Vec3d& place) const noexcept {
        constexpr double kLonger = 1.3;
        return neighborhood + kLonger * (place - center).norm() <= radius;
    }
    std::size_t room() const noexcept { return points.size() / 3; }
    float* axis(std::size_t a) noexcept { return points.data() + a * room(); }
    const float* axis(std::size_t a) const noexcept { return points.data() + a * room(); }
    PlaneLanes::Candidates candidates() const noexcept {
        return {axis(0), axis(1), axis(2),
                static_cast<std::uint32_t>((size + kLanes - 1) / kLanes)};
    }
};

/// Makes the patches of one thread. How far the last had to reach says where the next begins.
class PatchMaker {
public:
    /// @param most  points that a patch is better not to have.
    PatchMaker(std::span<const Vec3f> points, const PointTree& tree, unsigned k, std::size_t most)
        : points_(points),
          tree_(tree),
          kernels_(nearest_kernels()),
          k_(k),
          most_(most),
          nearest_(most) {}

    /// Of any patch.
    std::size_t room() const noexcept { return kAtMost * most_; }

    void make(const Vec3d& place, Patch& patch) {
        const Vec3f at = place.cast<float>();
        if (!find_wider(at, patch)) take_nearest(at, most_, patch);
    }
    /// Where points are about as near and dense as around the last place; else false.
    bool make_near(const Vec3d& place, Patch& patch) {
        const Vec3f at = place.cast<float>();
        if (find_near(at, patch)) return true;
        if (2 * patch.size < k_) return false;
        const double before = radius_;
        radius_ *= growth(patch.size);
        if (find_near(at, patch)) return true;
        radius_ = before;
        return false;
    }

private:
    static constexpr std::size_t kAtMost = 3;  // times `most`
    static constexpr double kExact = 0.99999;  // a radius less the rounding of squared distances
    static constexpr double kFilled = 0.6;     // of `most` by the next patch, if all goes well

    /// By how much a radius with so many points is to grow.
    double growth(std::size_t size) const {
        return std::sqrt(kFilled * static_cast<double>(most_) / static_cast<double>(size));
    }

    bool find_near(const Vec3f& at, Patch& patch) {
        constexpr std::size_t kBehind = kLanes;  // that may be written to
        patch.size = 0;
        patch.points.resize(3 * (room() + kBehind));
        const auto radius_sq = static_cast<float>(radius_ * radius_);
        if (!(radius_sq > 0) || !(radius_sq < std::numeric_limits<float>::infinity())) return false;
        patch.size =
            kernels_.around(tree_.view(), at.data(), radius_sq, static_cast<std::uint32_t>(room()),
                            patch.axis(0), patch.axis(1), patch.axis(2));
        if (patch.size > room()) {  // it got crowded
            take_nearest(at, k_, patch);
            return true;
        }
        if (patch.size < k_) return false;
        const bool all = patch.size == tree_.size();
        finish(at, radius_, all, patch);
        // On a surface the number of points grows as the square of the radius.
        radius_ *= growth(patch.size);
        return true;
    }

    /// The same, a few times wider where there are some, but too few.
    bool find_wider(const Vec3f& at, Patch& patch) {
        constexpr unsigned kTries = 3;
        constexpr double kWider = 2;
        const double before = radius_;
        for (unsigned i = 0; i < kTries; ++i) {
            if (find_near(at, patch)) return true;
            if (patch.size == 0) break;
            radius_ *= std::min(kWider, growth(patch.size));
        }
        radius_ = before;
        return false;
    }

    /// Without a radius to begin with.
    void take_nearest(const Vec3f& at, std::size_t count, Patch& patch) {
        const std::span<const Neighbor> found =
            find_nearest(tree_, at, std::span(nearest_).first(count));
        patch.size = 0;
        for (const Neighbor& neighbor : found) {
            const Vec3f way = points_[neighbor.index] - at;
            for (std::size_t a = 0; a < 3; ++a)
                patch.axis(a)[patch.size] = way[static_cast<Eigen::Index>(a)];
            ++patch.size;
        }
        const double farthest = std::sqrt(static_cast<double>(found.back().distance_sq));
        finish(at, farthest, found.size() == tree_.size(), patch);
        // From afar the radius says nothing of the spacing.
        if (4.0F * found.front().distance_sq <= found.back().distance_sq)
            radius_ = std::sqrt(kFilled) * farthest;
    }

    void finish(const Vec3f& at, double radius, bool all, Patch& patch) const {
        patch.center = at.cast<double>();
        patch.radius = all ? std::numeric_limits<double>::infinity() : radius * kExact;
        patch.neighborhood = radius * std::sqrt(k_ / static_cast<double>(patch.size));
        for (std::size_t a = 0; a < 3; ++a)
            std::fill_n(patch.axis(a) + patch.size, kLanes, PlaneLanes::kNowhere);
    }

    std::span<const Vec3f> points_;
    const PointTree& tree_;
    const NearestKernels& kernels_;
    unsigned k_;
    std::size_t most_;
    std::vector<Neighbor> nearest_;
    double radius_ = 0;
};

/// A query on its way.
struct Walker {
    static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

    std::size_t query = kNone, same_until = kNone;  ///< those from `query` are at the same place
    Vec3d q, x;
    Patch* patch = nullptr;
    bool own_patch = false;  ///< made for x just now, so that it holds what it must
    unsigned iteration = 0;
    double last_step = 0, least_step = 0, last_distance = 0;
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
          reach_(std::sqrt(std::max(1.0, kReaching / k_))),
          line_scale_(line_scale(k_)),
          maker_(points, tree, k_, std::min<std::size_t>(points.size(), 2 * k_ + 8)),
          lanes_(k_, maker_.room()),
          quadratic_(points, tree, options),
          kernel_(plane_kernel()) {
        ++shared_->uses;
    }

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
        if (next_ == end_) {
            lanes_.candidates[lane] = {};
            return;
        }
        ++busy_;
        w.query = next_;
        while (++next_ != end_ && queries_[next_] == queries_[w.query]) {
        }
        w.same_until = next_;
        w.q = queries_[w.query].cast<double>();
        w.direct = {};
        w.from_sample = !shared_->holds(w.q) &&
                        !share([&](Patch& patch) { return maker_.make_near(w.q, patch); });
        if (w.from_sample) {
            find_sample(w);
            share([&](Patch& patch) {
                maker_.make(w.sample, patch);
                return true;
            });
            w.from_sample = w.to_sample > reach_ * shared_->neighborhood;
        }
        give(lane, *shared_);
        start(lane, w.from_sample ? w.sample : w.q);
    }

    /// One that nobody uses: there is one more of them than can be in use.
    Patch& unused_patch() { return *std::ranges::find(patches_, 0U, &Patch::uses); }

    /// What make(patch) makes is shared from now on, unless it answers false.
    template <typename Make>
    bool share(Make&& make) {
        Patch& patch = unused_patch();
        if (!make(patch)) return false;
        --shared_->uses;
        shared_ = &patch;
        ++shared_->uses;
        return true;
    }

    void give(std::size_t lane, Patch& patch) {
        Walker& w = walkers_[lane];
        if (w.patch != nullptr) --w.patch->uses;
        w.patch = &patch;
        ++patch.uses;
        lanes_.candidates[lane] = patch.candidates();
        lanes_.radius_guess_sq[lane] = static_cast<float>(patch.neighborhood * patch.neighborhood);
        set(lanes_.query, lane, (w.q - patch.center).cast<float>());
    }

    /// The sample nearest to q, at a known distance: mostly one of the patch.
    void find_sample_near(Walker& w) const {
        const Patch& patch = *w.patch;
        const Vec3f q = (w.q - patch.center).cast<float>();
        if (static_cast<double>(q.norm()) + w.to_sample > patch.radius) return find_sample(w);
        const float *const x = patch.axis(0), *const y = patch.axis(1), *const z = patch.axis(2);
        std::size_t nearest = 0;
        float nearest_sq = std::numeric_limits<float>::infinity();
        for (std::size_t i = 0; i < patch.size; ++i) {
            const float distance_sq = (Vec3f(x[i], y[i], z[i]) - q).squaredNorm();
            nearest = distance_sq < nearest_sq ? i : nearest;
            nearest_sq = std::min(nearest_sq, distance_sq);
        }
        w.sample = patch.center + Vec3f(x[nearest], y[nearest], z[nearest]).cast<double>();
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
        place(lane, x);
    }

    void place(std::size_t lane, const Vec3d& x) {
        Walker& w = walkers_[lane];
        w.x = x;
        set(lanes_.place, lane, (x - w.patch->center).cast<float>());
    }

    void advance(std::size_t lane) {
        Walker& w = walkers_[lane];
        const double r = std::sqrt(static_cast<double>(lanes_.radius_sq[lane]));
        if (!w.own_patch && (w.x - w.patch->center).norm() + r > w.patch->radius) {
            Patch& own = unused_patch();
            maker_.make(w.x, own);
            give(lane, own);
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
        const std::optional<Step> found = step_of(lane, r);
        if (!found) return finish_start(lane);
        // There is no surface where there are no samples.
        const double nearness = lanes_.nearest_sq[lane] / found->reach_sq;
        constexpr double kLost = 0.5;
        if (w.iteration > 0 && nearness > kLost) return finish_start(lane);

        const Vec3d& foot = found->foot;
        const double step = found->length, h = found->h, distance = std::abs(found->height);
        if (options_.across_sample && w.from_sample && w.iteration == 0)
            w.off_surface = std::abs(found->height - found->normal.dot(w.q - w.sample));
        if (step < w.least_step) {
            w.least_step = step;
            w.best.point = foot;
            w.best.normal = found->normal;
            w.best.distance = distance;
            w.best.radius = r;
            w.best.h = h;
            w.best.off_center =
                3 * std::sqrt(static_cast<double>(found->offset_sq / found->reach_sq));
            w.best.emptiness = std::sqrt(nearness);
            w.best.roundness = (1 - found->line) * static_cast<double>(lanes_.roundness[lane]);
            w.best.line = found->line;
        }
        // Steps along the surface shrink by about the same factor each time, which the first step,
        // across it, does not tell; but normals turn by no more than about 2 / h. What the steps
        // would still add up to counts.
        const double shrinking = std::max(step / w.last_step, 2.0 * w.best.distance / h);
        w.best.converged =
            step <= options_.tolerance * h ||
            (shrinking < 0.5 && step * shrinking <= options_.tolerance * h * (1.0 - shrinking));
        // Where the way goes along the surface the distance is known long before the foot is.
        const double along = step / w.last_step, change = std::abs(distance - w.last_distance);
        w.best.converged |= w.iteration > 1 && along < 1 &&
                            change * along <= options_.sure_part * distance * (1 - along);
        w.last_step = step;
        w.last_distance = distance;
        if (w.best.converged || ++w.iteration == options_.max_iterations ||
            goes_round(w, foot, step, h))
            return finish_start(lane);
        place(lane, foot);
    }

    /// Where a walk goes next.
    struct Step {
        Vec3d foot, normal;
        double height;    ///< of the query over the foot, along the normal
        double length;    ///< of the step
        float reach_sq;   ///< how far points have a say, squared
        float offset_sq;  ///< from the place to their mean, squared
        double h;         ///< scale of their weights: a third of the reach
        double line;      ///< how far it is a step onto a line, not onto a plane
    };

    /// Onto the plane of the neighbourhood, or the line. Nothing where there is neither.
    /// @param r  radius of the neighbourhood.
    std::optional<Step> step_of(std::size_t lane, double r) const {
        const Walker& w = walkers_[lane];
        const Patch& patch = *w.patch;
        Step step = {.foot = patch.center + get(lanes_.foot, lane),
                     .normal = get(lanes_.normal, lane),
                     .height = static_cast<double>(lanes_.height[lane]),
                     .length = std::sqrt(static_cast<double>(lanes_.step_sq[lane])),
                     .reach_sq = lanes_.radius_sq[lane],
                     .offset_sq = lanes_.offset_sq[lane],
                     .h = r / 3.0,
                     .line = line_part(static_cast<double>(lanes_.breadth[lane]),
                                       static_cast<double>(lanes_.roundness[lane]))};
        const bool is_plane = lanes_.flat[lane];
        if (step.line == 0) return is_plane ? std::optional(step) : std::nullopt;

        const Vec3d place = w.x - patch.center;
        const std::optional<LocalLine> line =
            fit_line({{patch.axis(0), patch.axis(1), patch.axis(2)}, patch.size}, place,
                     line_scale_ * step.h, r);
        if (!line) return std::nullopt;
        const Vec3d foot = patch.center + line->foot_of(w.q - patch.center);
        step.foot = is_plane ? Vec3d(step.foot + step.line * (foot - step.foot)) : foot;
        const Vec3d way = w.q - step.foot;
        step.height = way.norm();
        step.normal = step.height > 0 ? Vec3d(way / step.height) : line->direction.unitOrthogonal();
        step.length = (step.foot - w.x).norm();
        step.h *= 1 - step.line + step.line * line_scale_;
        step.reach_sq = static_cast<float>(9 * step.h * step.h);
        step.offset_sq = static_cast<float>((line->point - place).squaredNorm());
        return step;
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
            find_sample_near(w);
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
        for (std::size_t i = w.query; i < w.same_until; ++i) found_(i, foot);
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
    double reach_;  ///< of the surface around a sample, over the radius of its neighbourhood
    double line_scale_;
    PatchMaker maker_;
    PlaneLanes lanes_;
    QuadraticFoot quadratic_;
    PlaneKernel kernel_;
    std::array<Patch, kLanes + 2> patches_;  ///< those of the lanes, a shared and an unused one
    Patch* shared_ = &patches_.front();
    std::array<Walker, kLanes> walkers_;
    std::size_t busy_ = 0;
};

}  // namespace

FootFinder::FootFinder(std::span<const Vec3f> points, const PointTree& tree, const Options& options)
    : points_(points), tree_(tree), options_(options) {}

FootFinder::Overhang FootFinder::overhang_of(const Vec3f& place, const Foot& foot,
                                             std::size_t count) const {
    Overhang overhang;
    if (!foot.is_one_sided() && !foot.beyond) return overhang;
    const Vec3f normal = foot.normal.cast<float>(), u = normal.unitOrthogonal(),
                v = normal.cross(u);
    std::array<Neighbor, kMostAround> room;
    std::array<Eigen::Vector2f, kMostAround> flat;
    std::size_t n = 0;
    for (const Neighbor& neighbor : find_nearest(tree_, place, std::span(room).first(count))) {
        const Vec3f way = points_[neighbor.index] - place;
        overhang.reach = std::max(overhang.reach, way.norm());
        flat[n++] = {way.dot(u), way.dot(v)};
    }
    overhang.way = way_to_hull(std::span(flat).first(n));
    return overhang;
}

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
