#include "contraction/surface_fit.hpp"

#include "base/large_memory.hpp"
#include "base/parallel_for.hpp"
#include "cloud/float4.hpp"
#include "contraction/contraction.hpp"
#include "contraction/fit_kernels.hpp"
#include "neighbors/leaf_query.hpp"
#include "neighbors/point_tree.hpp"

#include <algorithm>
#include <array>
#include <cmath>

// Follows: Pauly, Gross, Kobbelt 2002, §2.2 (the surface) and §4 (its distance); Levenberg 1944 (a
// step towards the least sum of squares, damped); Hestenes and Stiefel 1952 (conjugate gradients
// for the points of a patch together: what one of them does the surface for its neighbours need not
// do again).

namespace stipple {
namespace {

constexpr std::size_t kNeighbors = FitLanes::kRows;  // of a point, itself among them
constexpr std::size_t kWidth = PointTree::kWidth;
static_assert(kWidth == FitLanes::kLanes);
constexpr float kReach = 3.0F;  // in h
constexpr std::size_t kBlock = 32;
/// Members asked of the points of a patch, at least; fewer than twice as many.
constexpr std::size_t kPatch = 16'384;

constexpr std::size_t kMostFitters = 128;  // each has a number for every leaf

constexpr int kIterations = 3;

using Square = std::array<Float4, 4>;

Square transposed(const Square& m) {
    const Float4 a = __builtin_shufflevector(m[0], m[1], 0, 4, 1, 5),
                 b = __builtin_shufflevector(m[0], m[1], 2, 6, 3, 7),
                 c = __builtin_shufflevector(m[2], m[3], 0, 4, 1, 5),
                 d = __builtin_shufflevector(m[2], m[3], 2, 6, 3, 7);
    return {__builtin_shufflevector(a, c, 0, 1, 4, 5), __builtin_shufflevector(a, c, 2, 3, 6, 7),
            __builtin_shufflevector(b, d, 0, 1, 4, 5), __builtin_shufflevector(b, d, 2, 3, 6, 7)};
}

/// Numbers of one point for each of eight.
using Numbers = std::array<Index, kWidth>;

void gather(const std::vector<Float4>& from, const Numbers& numbers, FitLanes::Row& to) {
    for (std::size_t lane = 0; lane < kWidth; lane += 4) {
        const Index* n = &numbers[lane];
        const Square columns = transposed({from[n[0]], from[n[1]], from[n[2]], from[n[3]]});
        __builtin_memcpy(&to.x[lane], &columns[0], sizeof columns[0]);
        __builtin_memcpy(&to.y[lane], &columns[1], sizeof columns[1]);
        __builtin_memcpy(&to.z[lane], &columns[2], sizeof columns[2]);
    }
}

void add_scattered(const FitLanes::Row& row, const FitLanes::Floats& fourth, const Numbers& numbers,
                   std::vector<Float4>& to) {
    for (std::size_t half = 0; half < kWidth; half += 4) {
        const Square each = transposed(
            {load(&row.x[half]), load(&row.y[half]), load(&row.z[half]), load(&fourth[half])});
        for (std::size_t lane = 0; lane < 4; ++lane) to[numbers[half + lane]] += each[lane];
    }
}

/// The eight points of a leaf and what some input points of each ask: that moves of its neighbours
/// along the gradients of the surface's height, linear and quadratic, add up to their distances
/// from it.
struct Group {
    std::array<Numbers, kNeighbors> neighbors;
    FitLanes::Floats reach_sq;  ///< of the farthest neighbour
    FitLanes::Floats
        layered;  ///< 1 where the neighbours lie in two layers, else 0: nothing is asked
    std::array<bool, kWidth> apart;  ///< those of no surface: they ask nothing, and stay
    FitWishes wishes;                ///< each of eight input points, one for each point
};

/// Whether a point is off all surfaces: the farther half of its neighbours lie together, seen from
/// there. A surface through those and the point would be one of chance, and far from some of them.
bool is_apart(const FitLanes& lanes, std::size_t lane, float reach_sq) {
    constexpr float kTogether = 1.0F / 16;  // of the reach
    const auto at = [&](std::size_t row) {
        const FitLanes::Row& around = lanes.around[row];
        return Vec3f(around.x[lane], around.y[lane], around.z[lane]);
    };
    const Vec3f farthest = at(kNeighbors - 1);
    for (std::size_t row = kNeighbors / 2; row < kNeighbors - 1; ++row)
        if (!((at(row) - farthest).squaredNorm() < kTogether * kTogether * reach_sq)) return false;
    return true;
}

float sum(Float4 v) {
    return (v[0] + v[1]) + (v[2] + v[3]);
}

/// Weighs the quadratic surface as much as the linear one, and more where it is the closer by far:
/// where points that are pushed out until the linear surface, which lies inside, meets the input
/// half way would spoil it.
/// @param size  of what neighbours are numbers of.
void weigh_quadratic(std::span<Group> groups, std::size_t size, float close) {
    std::vector<float> between(size), beside(size);  // squared: the surfaces, the input
    for (const Group& group : groups) {
        for (std::size_t lane = 0; lane < kWidth; ++lane) {
            float inside_sq = 0, distance_sq = 0;
            for (const FitAnswers& wish : std::span(group.wishes.answers, group.wishes.count)) {
                const float quadratic = wish.quadratic_distance[lane],
                            inside = wish.linear_distance[lane] - quadratic;
                inside_sq += inside * inside;
                distance_sq += quadratic * quadratic;
            }
            for (const Numbers& row : group.neighbors) {
                between[row[lane]] += inside_sq;
                beside[row[lane]] += distance_sq;
            }
        }
    }
    for (Group& group : groups) {
        for (std::size_t lane = 0; lane < kWidth; ++lane) {
            float b = 0, q = 0;
            for (const Numbers& row : group.neighbors) {
                b += between[row[lane]];
                q += beside[row[lane]];
            }
            constexpr float kMost = 16;  // or damping, which is one for all, would hold the others
            group.wishes.quadratic_weight[lane] =
                q > 0 ? std::clamp(close * close * b / q, 1.0F, kMost) : 1;
        }
    }
}

/// Damped least squares by conjugate gradients: the moves of all points that please their wishes
/// best.
class Agreement {
public:
    /// @param size  of what neighbours are numbers of. @param damping  as of `SurfaceFit`.
    Agreement(std::span<const Group> groups, std::size_t size, float damping)
        : groups_(groups), residual_(size), direction_(size), image_(size), stiffness_(size) {
        std::array<FitLanes::Row, kNeighbors> wanted;
        std::array<FitLanes::Floats, kNeighbors> squares;
        for (const Group& group : groups) {
            kernel_.want(group.wishes, wanted.data(), squares.data());
            for (std::size_t i = 0; i < kNeighbors; ++i)
                add_scattered(wanted[i], squares[i], group.neighbors[i], residual_);
        }
        double total = 0;
        for (std::size_t p = 0; p < size; ++p) {
            stiffness_[p] = residual_[p][3];
            residual_[p][3] = 0;
            total += static_cast<double>(stiffness_[p]);
        }
        damping_ =
            damping * static_cast<float>(total / static_cast<double>(kWidth * groups.size()));
    }

    std::vector<Float4> moves(const RunContext& context) {
        std::vector<Float4> moved(residual_.size());
        double length = turn(0);
        for (int i = 0; i < kIterations && length > 0; ++i) {
            context.throw_if_stopped();
            const auto step = static_cast<float>(length / look_along());
            for (std::size_t p = 0; p < moved.size(); ++p) {
                moved[p] += step * direction_[p];
                residual_[p] -= step * image_[p];
            }
            length = turn(length);
        }
        return moved;
    }

private:
    /// The next direction, conjugate to the last. @return the residual's squared length.
    double turn(double length_before) {
        double length = 0;
        const auto scaled = [&](std::size_t p) {
            return residual_[p] / (stiffness_[p] + damping_);
        };
        if (!(damping_ > 0)) return 0;
        for (std::size_t p = 0; p < residual_.size(); ++p)
            length += static_cast<double>(sum(residual_[p] * scaled(p)));
        const auto kept = static_cast<float>(length_before > 0 ? length / length_before : 0);
        for (std::size_t p = 0; p < residual_.size(); ++p)
            direction_[p] = scaled(p) + kept * direction_[p];
        return length;
    }

    /// What all wishes and the damping say of the direction. @return its curvature.
    double look_along() {
        for (std::size_t p = 0; p < image_.size(); ++p) image_[p] = damping_ * direction_[p];
        std::array<FitLanes::Row, kNeighbors> direction, image;
        for (const Group& group : groups_) {
            for (std::size_t i = 0; i < kNeighbors; ++i)
                gather(direction_, group.neighbors[i], direction[i]);
            kernel_.look_along(group.wishes, direction.data(), image.data());
            for (std::size_t i = 0; i < kNeighbors; ++i)
                add_scattered(image[i], {}, group.neighbors[i], image_);
        }
        double curvature = 0;
        for (std::size_t p = 0; p < image_.size(); ++p)
            curvature += static_cast<double>(sum(direction_[p] * image_[p]));
        return curvature;
    }

    const FitKernel& kernel_ = fit_kernel();
    std::span<const Group> groups_;
    std::vector<Float4> residual_, direction_, image_;
    std::vector<float> stiffness_;
    float damping_ = 0;
};

/// What is fitted to what, the same for every patch.
struct Task {
    /// @param scale  times the input, that is where the points are.
    Task(std::span<const Vec3f> points_, std::span<const Vec3f> input_, float scale_,
         const MemberLists& members_, const SurfaceFit& options_, const RunContext& context)
        : points(points_),
          input(input_),
          scale(scale_),
          members(members_),
          options(options_),
          tree(points, options.in_order ? PointTree::Leaves::Given : PointTree::Leaves::Compact,
               context),
          slot(points.size()) {
        parallel_for_blocks(
            tree.leaf_count(), 512, context, [&](std::size_t begin, std::size_t end) {
                for (std::size_t l = begin; l < end; ++l)
                    for (std::size_t lane = 0; lane < tree.points_in(l); ++lane)
                        slot[tree.leaf(l).index[lane]] = static_cast<Index>(kWidth * l + lane);
            });
    }

    std::span<const Vec3f> points, input;
    float scale;
    const MemberLists& members;
    const SurfaceFit& options;
    PointTree tree;
    std::vector<Index> slot;  ///< in the tree, by point
};

/// Fits the points of a patch, with the wishes for those around it too, which then are dropped: so
/// the memory of all is bounded. One after the other in the same memory.
class PatchFitter {
public:
    PatchFitter(const Task& task, const RunContext& context)
        : task_(task), context_(context), place_(task.tree.leaf_count(), PointTree::kNone) {}

    /// Moves the points of the leaves `begin .. end`.
    void fit(std::size_t begin, std::size_t end, std::span<Vec3f> points) {
        for (std::size_t l = begin; l < end; ++l) place(l);
        const std::size_t own = leaves_.size();
        ask_for(0, own, own_wishes_);
        ask_for(own, leaves_.size(), wishes_around_);
        const std::size_t size = kWidth * leaves_.size();
        weigh_quadratic(groups_, size, task_.options.close);
        const auto moved = Agreement(groups_, size, task_.options.damping).moves(context_);
        for (std::size_t l = 0; l < own; ++l) {
            for (std::size_t lane = 0; lane < task_.tree.points_in(leaves_[l]); ++lane) {
                const Index point = task_.tree.leaf(leaves_[l]).index[lane];
                if (groups_[l].apart[lane]) continue;
                const Float4 move = moved[kWidth * l + lane];
                points[point] +=
                    bounded(is_layered(groups_[l], lane) ? amid_members(point) - points[point]
                                                         : Vec3f(move[0], move[1], move[2]),
                            groups_[l].reach_sq[lane]);
            }
        }
        for (const Index l : leaves_) place_[l] = PointTree::kNone;
        leaves_.clear();
        groups_.clear();
    }

private:
    /// Room for the wishes of some groups, each a number of `FitAnswers`.
    struct Wishes {
        LargeArray<FitAnswers> memory;

        std::span<FitAnswers> of(std::size_t count) {
            if (memory.size() < count) memory = LargeArray<FitAnswers>(count);
            return std::span(memory.data(), count);
        }
    };

    /// Whether it is so around most of a point's neighbours: around one of them it may be chance.
    bool is_layered(const Group& group, std::size_t lane) const {
        float layered = 0;
        for (const Numbers& row : group.neighbors)
            layered += groups_[row[lane] / kWidth].layered[row[lane] % kWidth];
        return 2 * layered > static_cast<float>(kNeighbors);
    }

    Vec3f amid_members(Index point) const {
        const auto list = task_.members.of(point);
        Vec3d sum = Vec3d::Zero();
        for (const Index member : list) sum += task_.input[member].cast<double>();
        return task_.scale * (sum / static_cast<double>(list.size())).cast<float>();
    }

    Vec3f bounded(const Vec3f& move, float reach_sq) const {
        const float most = task_.options.farthest_move / kReach * std::sqrt(reach_sq);
        return move.squaredNorm() > most * most ? move.normalized() * most : move;
    }

    /// Where the leaf stands among those of the patch, to which it is added.
    Index place(std::size_t leaf) {
        if (place_[leaf] == PointTree::kNone) {
            place_[leaf] = static_cast<Index>(leaves_.size());
            leaves_.push_back(static_cast<Index>(leaf));
        }
        return place_[leaf];
    }

    /// Adds groups for the leaves `begin .. end` of the patch, and the leaves they are about.
    void ask_for(std::size_t begin, std::size_t end, Wishes& room) {
        groups_.resize(end);
        const unsigned asked = task_.options.asked;
        const std::span wishes = room.of(asked * (end - begin));
        parallel_for_blocks(end - begin, kBlock, context_,
                            [&](std::size_t first, std::size_t last) {
                                LeafQuery query(task_.tree, task_.points, kNeighbors - 1);
                                for (std::size_t i = first; i < last; ++i) {
                                    Group& group = groups_[begin + i];
                                    const auto answers = wishes.subspan(asked * i, asked);
                                    group.wishes.answers = answers.data();
                                    group.wishes.count = answers.size();
                                    ask(leaves_[begin + i], query, group, answers);
                                }
                            });
        for (Group& group : std::span(groups_).subspan(begin)) {
            for (Numbers& row : group.neighbors) {
                for (Index& number : row) {
                    const Index slot = task_.slot[number];
                    number = static_cast<Index>(kWidth * place(slot / kWidth) + slot % kWidth);
                }
            }
        }
    }

    /// Fills the group of a leaf; neighbours by their indices.
    void ask(std::size_t l, LeafQuery& query, Group& group, std::span<FitAnswers> answers) const {
        const PointTree::Leaf& leaf = task_.tree.leaf(l);
        for (Numbers& row : group.neighbors) row.fill(leaf.index[0]);
        group.apart = {};
        FitLanes lanes{};
        FitLanes::Floats& reach_sq = group.reach_sq;
        reach_sq = {};
        const auto set = [](FitLanes::Row& row, std::size_t lane, const Vec3f& v) {
            row.x[lane] = v.x();
            row.y[lane] = v.y();
            row.z[lane] = v.z();
        };
        query.run(l, [&](std::size_t lane, const Candidates& near, const Chosen& chosen) {
            group.neighbors[0][lane] = leaf.index[lane];
            std::array<std::uint32_t, kNeighbors> slots;  // by rank; those too many in the last
            for (std::uint32_t i = 0; i < chosen.count; ++i)
                slots[std::min<std::uint32_t>(chosen.rank[i], kNeighbors - 1)] = chosen.slot[i];
            for (std::size_t row = 1; row < kNeighbors; ++row) {
                const std::uint32_t slot = slots[row - 1];
                group.neighbors[row][lane] = near.index[slot];
                const Vec3f d =
                    Vec3f(near.x[slot], near.y[slot], near.z[slot]) - leaf.position(lane);
                set(lanes.around[row], lane, d);
                reach_sq[lane] = std::max(reach_sq[lane], d.squaredNorm());
            }
            group.apart[lane] = is_apart(lanes, lane, reach_sq[lane]);
        });
        const auto per_h = [&](std::size_t lane) { return kReach / std::sqrt(reach_sq[lane]); };
        for (std::size_t lane = 0; lane < task_.tree.points_in(l); ++lane)
            lanes.per_h[lane] = reach_sq[lane] > 0 ? per_h(lane) : 0;
        const FitKernel& kernel = fit_kernel();
        kernel.layers(lanes, group.layered);
        for (unsigned a = 0; a < task_.options.asked; ++a) {
            for (std::size_t lane = 0; lane < task_.tree.points_in(l); ++lane) {
                const auto list = task_.members.of(leaf.index[lane]);
                const std::size_t count = std::min<std::size_t>(task_.options.asked, list.size());
                lanes.per_h[lane] = 0;
                if (a >= count || group.layered[lane] > 0 || group.apart[lane]) continue;
                // As evenly through the list as can be.
                const Index member = list[(2 * a + 1) * list.size() / (2 * count)];
                const Vec3f at = task_.scale * task_.input[member] - leaf.position(lane);
                if (!(at.squaredNorm() < reach_sq[lane])) continue;
                set(lanes.place, lane, at);
                lanes.per_h[lane] = per_h(lane);
            }
            kernel.run(lanes, answers[a]);
        }
    }

    const Task& task_;
    const RunContext& context_;
    std::vector<Index> leaves_;  ///< of the patch, then those around it
    std::vector<Index> place_;   ///< among those, by leaf; else kNone
    std::vector<Group> groups_;  ///< of these leaves, but those at the end, which ask nothing
    Wishes own_wishes_, wishes_around_;  ///< of these groups
};

}  // namespace

void fit_surface(std::vector<Vec3f>& points, std::span<const Vec3f> input,
                 const MemberLists& members, const SurfaceFit& options, const RunContext& context) {
    if (points.size() < kNeighbors) return;
    // Of a size of about 1, so that no square under- or overflows.
    const auto scale = static_cast<float>(contraction_scale(points, context));
    for (Vec3f& p : points) p *= scale;
    const std::vector<Vec3f> before = points;
    const Task task(before, input, scale, members, options, context);
    const std::size_t leaves = task.tree.leaf_count(),
                      patches = std::max<std::size_t>(1, kWidth * leaves * options.asked / kPatch),
                      together = 1 + patches / kMostFitters;
    parallel_for_blocks(patches, together, context, [&](std::size_t begin, std::size_t end) {
        PatchFitter fitter(task, context);
        for (std::size_t patch = begin; patch < end; ++patch)
            fitter.fit(patch * leaves / patches, (patch + 1) * leaves / patches, points);
    });
    for (Vec3f& p : points) p /= scale;
}

}  // namespace stipple
